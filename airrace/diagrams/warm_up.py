"""Compiles what a race calls before it starts: its own clock should not count that."""

import contextlib
import dataclasses as dc
import os
import subprocess
import sys
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder

from airrace.common import jit
from airrace.common.held_folders import temporary_folder
from airrace.common.processes import bound_to
from airrace.common.python_path import module_command
from airrace.common.waiting import waiting
from airrace.diagrams.autonomy import MakeNavigator, MakePilot
from airrace.diagrams.simulation import MakeSimulation
from airrace.diagrams.standing_drone import Standing, StandingDrone
from airrace.diagrams.wiring import connect_by_name, initial_values, inputs_of, outputs_of
from airrace.scenario import INTERNAL, Scenario, load_scenario, scenario_yaml
from airrace.scenario.camera_config import NO_CAMERA, CameraConfig
from airrace.systems.types import ExplorerStatus

_TIME = 0.6  # s: it has seen, measured and mapped, and takes off by then
_REST = 2.0  # s, more on its pad if it has to find out itself where it is
_BRIEF = 0.3  # s: it has seen by then
_TICK = 0.01  # s, between two looks at what it answers


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


def warm_up_half(scenario: Scenario, which: str) -> None:
    """Flies one half of the autonomy alone for a moment, and forgets it.

    Args:
        scenario: of the race.
        which: "pilot" or "navigator".
    """
    halves = {"pilot": MakePilot(scenario), "navigator": MakeNavigator(scenario)}
    part = halves.pop(which)
    (other,) = halves.values()
    duration = _TIME + _REST * scenario.localizes
    simulator = Simulator(_before_gate(scenario, part, other, duration))
    context = simulator.get_mutable_context()
    for time in np.arange(0.0, duration, _TICK).tolist():
        simulator.AdvanceTo(time)
        for port in outputs_of(part).values():
            port.Eval(part.GetMyContextFromRoot(context))


def _before_gate(scenario: Scenario, part: Diagram, other: Diagram, duration: float) -> Diagram:
    """Returns a half of the autonomy with what it gets where a drone stands before a gate.

    Args: part, other: the half, and the other one. duration: of the flight (s).
    """
    names = inputs_of(part)
    told = [name for name in names if other.HasOutputPort(name)]
    drone = StandingDrone(
        Standing(scenario, duration),
        initial_values(other, part, told),
        [name for name in names if name not in told],
        scenario.camera.fps,
    )
    builder = DiagramBuilder()
    builder.AddSystem(part)
    builder.AddSystem(drone)
    connect_by_name(builder, [part], outputs_of(drone))
    return builder.Build()


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
    with waiting("Compiling, once; it takes a minute or two"), jit.locked():
        if not jit.is_complete(scenario.estimator):  # by another race, which had the lock before
            _compile_apart(scenario)


def _compile_apart(scenario):
    jit.remove_stale()
    blind = scenario.camera.renderer == NO_CAMERA
    scenario = dc.replace(scenario, flight_controller=INTERNAL)
    scenario = dc.replace(scenario, map="", camera=CameraConfig() if blind else scenario.camera)
    # The other process has another __main__ than a script or notebook with systems of its own.
    systems = {n: path for n, path in scenario.systems.items() if not path.startswith("__main__:")}
    scenario = dc.replace(scenario, systems=systems)
    with temporary_folder() as folder, contextlib.ExitStack() as stack:
        path = folder / "scenario.yaml"
        path.write_text(scenario_yaml(scenario), encoding="utf-8")
        command = module_command(__name__, str(path))
        silent: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        compilers = []
        for part in _PARTS:
            words = [*command, part, str(os.getpid())]
            compiler = subprocess.Popen(words, **silent)
            compilers.append(stack.enter_context(compiler))
            stack.callback(compiler.kill)  # of no use any more, should this be interrupted
        codes = [compiler.wait() for compiler in compilers]
    if not any(codes):
        jit.set_complete(scenario.estimator)


def _warm_up_flight(scenario: Scenario) -> None:
    warm_up_simulation(scenario)
    warm_up_half(scenario, "pilot")


_PARTS = {
    "flight": _warm_up_flight,
    "navigator": lambda scenario: warm_up_half(scenario, "navigator"),
}

if __name__ == "__main__":
    with bound_to(int(sys.argv[3])):
        _PARTS[sys.argv[2]](load_scenario(filename=sys.argv[1]))
