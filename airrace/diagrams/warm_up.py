"""Compiles what a race calls before it starts: in real time there is no time for it."""

import dataclasses as dc
import subprocess
import sys
import tempfile
from pathlib import Path

from pydrake.systems.analysis import Simulator
from rich.console import Console

from airrace.common import jit
from airrace.common.processes import child_environment
from airrace.diagrams.made_up_messages import standing
from airrace.diagrams.playback import LINK, Playback
from airrace.diagrams.race import MakeRace
from airrace.diagrams.simulated_link import SimulatedRemote
from airrace.scenario import LINK_DELAY, Scenario, load_scenario, scenario_yaml
from airrace.scenario.camera_config import NO_CAMERA, CameraConfig

_TIME = 0.6  # s: it has seen, measured and mapped, and takes off by then
_BRIEF = 0.3  # s: it has seen by then


def warm_up(scenario: Scenario) -> None:
    """Flies the first moment of a race over a link, all in this process, and forgets it.

    The machine code of the inner loops is compiled, or read from the disk, when it is
    first called (see airrace/common/jit.py).

    Args:
        scenario: of the race.
    """
    scenario = dc.replace(scenario, link_delay=LINK_DELAY)
    with tempfile.TemporaryDirectory() as folder:
        transport = SimulatedRemote(scenario, LINK, Path(folder))
        simulator = Simulator(MakeRace(scenario, transport=transport))
        simulator.Initialize()
        transport.begin(simulator)
        transport.advance(simulator, _TIME)


def warm_up_autonomy(scenario: Scenario, briefly: bool = False) -> None:
    """Flies the autonomy alone for a moment, and forgets it.

    What simulates and draws is not called: a companion does not need it, and a board takes
    minutes to compile it.

    Args:
        scenario: of the race.
        briefly: to go on with a race: the code is on the disk, and a drone is hovering.
    """
    scenario = dc.replace(scenario, link_delay=LINK_DELAY)
    duration = _BRIEF if briefly else _TIME
    with tempfile.TemporaryDirectory() as folder:
        playback = Playback(scenario, Path(folder))
        playback.play(standing(scenario, playback.channels, duration), duration)


def compile_apart(scenario: Scenario) -> None:
    """Lets another process compile what a race calls, if none has done so yet.

    A compiler does not give back what it took, some 300 MB, and a race's own clock
    should not count the first one's minute. If it fails, nothing is lost: what
    is not on the disk is compiled when it is called.

    Args:
        scenario: of the race.
    """
    if jit.is_on_disk():
        return
    jit.remove_stale()
    blind = scenario.camera.renderer == NO_CAMERA
    # A link is for races that explore.
    scenario = dc.replace(scenario, map="", camera=CameraConfig() if blind else scenario.camera)
    # The other process has another __main__ than a script or notebook with systems of its own.
    systems = {n: path for n, path in scenario.systems.items() if not path.startswith("__main__:")}
    scenario = dc.replace(scenario, systems=systems)
    with (
        tempfile.TemporaryDirectory() as folder,
        Console(stderr=True).status("Compiling, once; it takes about a minute"),
    ):
        path = Path(folder) / "scenario.yaml"
        path.write_text(scenario_yaml(scenario), encoding="utf-8")
        subprocess.run(
            [sys.executable, "-m", __name__, str(path)],
            env=child_environment(),
            capture_output=True,
        )


if __name__ == "__main__":
    warm_up(load_scenario(filename=sys.argv[1]))
