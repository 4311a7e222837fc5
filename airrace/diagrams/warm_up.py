"""Compiles what a race calls before it starts: in real time there is no time for it."""

import dataclasses as dc
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from pydrake.systems.analysis import Simulator
from rich.console import Console

from airrace.common import jit
from airrace.common.processes import child_environment
from airrace.diagrams.made_up_messages import handed_over, standing
from airrace.diagrams.playback import LINK, NavigatorPlayback, PilotPlayback, Playback
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


def warm_up_pilot(scenario: Scenario, briefly: bool = False) -> None:
    """Flies the pilot alone for a moment, and forgets it.

    What simulates and draws is not called, nor what the navigator runs: a companion does not need
    the one, and compiles the other in the navigator's process. A board takes minutes to compile.

    Args:
        scenario: of the race.
        briefly: to go on with a race: the code is on the disk, and a drone is hovering.
    """
    play_pilot(scenario, _BRIEF if briefly else _TIME)


def warm_up_navigator(scenario: Scenario, briefly: bool = False) -> None:
    """Flies the navigator alone for a moment, and forgets it; see warm_up_pilot()."""
    play_navigator(scenario, _BRIEF if briefly else _TIME)


def play_pilot(scenario: Scenario, duration: float) -> np.ndarray:
    """Flies the pilot alone by made-up messages, and forgets it.

    Args:
        scenario: of the race.
        duration: (s).

    Returns:
        how long it took for each millisecond (s), (n,).
    """
    scenario = dc.replace(scenario, link_delay=LINK_DELAY)
    return _play(PilotPlayback(scenario), scenario, duration)


def play_navigator(scenario: Scenario, duration: float) -> np.ndarray:
    """Flies the navigator alone by made-up messages, and forgets it; see play_pilot()."""
    scenario = dc.replace(scenario, link_delay=LINK_DELAY)
    with tempfile.TemporaryDirectory() as folder:
        return _play(NavigatorPlayback(scenario, Path(folder)), scenario, duration)


def _play(playback: Playback, scenario: Scenario, duration: float) -> np.ndarray:
    return playback.play(
        standing(scenario, playback.channels, duration),
        handed_over(scenario, playback.told, duration),
        duration,
    )


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
