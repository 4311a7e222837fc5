"""Compiles what a race calls before it starts: in real time there is no time for it."""

import contextlib
import dataclasses as dc
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from rich.console import Console

from airrace.common import jit
from airrace.common.processes import child_environment
from airrace.diagrams.made_up_messages import handed_over, standing
from airrace.diagrams.playback import LINK, NavigatorPlayback, PilotPlayback, Playback
from airrace.diagrams.race import MakeRace
from airrace.diagrams.simulated_link import SimulatedRemote
from airrace.diagrams.simulation import MakeSimulation
from airrace.scenario import LINK_DELAY, Scenario, load_scenario, scenario_yaml
from airrace.scenario.camera_config import NO_CAMERA, CameraConfig
from airrace.systems.control.rotor_commands import set_speeds
from airrace.systems.types import ExplorerStatus

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
    # So early no rotor is at a limit: then this is called for what the controller wants otherwise.
    one = np.zeros(1)
    set_speeds(one, one, one, one, one, one, 1.0)


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


def warm_up_simulation(scenario: Scenario) -> None:
    """Lets the simulation alone run for a moment, its drone at rest, and forgets it.

    Args:
        scenario: of the race.
    """
    simulation = MakeSimulation(scenario)
    simulator = Simulator(simulation)
    context = simulator.get_mutable_context()
    command = simulation.GetInputPort("rotor_speed_command")
    command.FixValue(context, np.zeros(command.size()))
    status = Value[object](ExplorerStatus())
    simulation.GetInputPort("explorer_status").FixValue(context, status)
    for time in np.linspace(0.0, _BRIEF, 4):
        simulator.AdvanceTo(time)
        for i in range(simulation.num_output_ports()):
            simulation.get_output_port(i).Eval(context)


def compile_apart(scenario: Scenario) -> None:
    """Lets other processes compile what a race calls, if none has done so yet.

    A compiler does not give back what it took, some 300 MB, and a race's own clock
    should not count the first one's minute. What flies and what navigates are compiled at the
    same time; the first takes two thirds as long as the second. Races that start at once wait for
    the one that compiles. If it fails, nothing is lost: what is not on the disk is compiled when
    it is called.

    Args:
        scenario: of the race.
    """
    if jit.is_complete(scenario.estimator):
        return
    with Console(stderr=True).status("Compiling, once; it takes about a minute"), jit.locked():
        if not jit.is_complete(scenario.estimator):  # by another race, which had the lock before
            _compile_apart(scenario)


def _compile_apart(scenario):
    jit.remove_stale()
    blind = scenario.camera.renderer == NO_CAMERA
    # A link is for races that explore.
    scenario = dc.replace(scenario, map="", camera=CameraConfig() if blind else scenario.camera)
    # The other process has another __main__ than a script or notebook with systems of its own.
    systems = {n: path for n, path in scenario.systems.items() if not path.startswith("__main__:")}
    scenario = dc.replace(scenario, systems=systems)
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        path = Path(folder) / "scenario.yaml"
        path.write_text(scenario_yaml(scenario), encoding="utf-8")
        command = [sys.executable, "-m", __name__, str(path)]
        silent: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        compilers = []
        for part in _PARTS:
            compiler = subprocess.Popen([*command, part], env=child_environment(), **silent)
            compilers.append(stack.enter_context(compiler))
            stack.callback(compiler.kill)  # of no use any more, should this be interrupted
        codes = [compiler.wait() for compiler in compilers]
    if not any(codes):
        jit.set_complete(scenario.estimator)


def _warm_up_flight(scenario):
    warm_up_simulation(scenario)
    warm_up_pilot(scenario)


_PARTS = {"flight": _warm_up_flight, "navigator": warm_up_navigator}

if __name__ == "__main__":
    _PARTS[sys.argv[2]](load_scenario(filename=sys.argv[1]))
