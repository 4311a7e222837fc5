"""The Default drone on the circle, under its geometric controller.

.venv/bin/python -m benchmarks.peers.fly_airrace
"""

from importlib.metadata import version

import numpy as np
from pydrake.systems.analysis import Simulator

from airrace.diagrams.flight import MakeFlight, start_in_flight
from airrace.scenario import Scenario
from benchmarks.flights import PERIOD as LOOK
from benchmarks.flights import start_on
from benchmarks.peers import circle
from benchmarks.stopwatch import Stopwatch, watching

RATES = (100, 500)  # Hz, of the controller: the peers'; the last is the default, too
_REST = "reading the state"


def main() -> None:
    """Flies at each rate, and once more to see what takes the time at the last."""
    circle.on_one_core()
    rows = [row(rate) for rate in RATES]
    circle.report(f"airrace, Drake {version('drake')}", rows, shares=shares(RATES[-1]))


def row(rate: float) -> dict:
    """Returns what circle.timed() says of a flight at a rate of the controller (Hz)."""
    scenario = _scenario(rate)
    return circle.timed(
        flight(scenario),
        controller="GeometricController",
        besides="contact, referee, noise of the state, filter, rotor monitor",
        position_hz=rate,
        attitude_hz=rate,
        physics_hz=round(1.0 / scenario.plant_config.time_step),
        integrator="MultibodyPlant",
    )


def shares(rate: float) -> dict:
    """Returns name to share of the CPU time of every box, at a rate of the controller (Hz)."""
    stopwatch = Stopwatch(_REST)
    drake = {"pydrake.systems.analysis:Simulator.AdvanceTo": "Drake's plant and Simulator"}
    with watching(stopwatch, drake):
        fly = flight(_scenario(rate))
        fly(0.0, circle.PERIOD)
        before = stopwatch.snapshot()
        fly(circle.PERIOD, 2.0 * circle.PERIOD)
        after = stopwatch.snapshot()
    taken = {name: after[name][0] - before[name][0] for name in after}
    whole = sum(taken.values())
    return {name: seconds / whole for name, seconds in taken.items()}


def _scenario(rate):
    scenario = Scenario()
    scenario.controller.rate = float(rate)
    for box in (scenario.state_filter, scenario.rotor_monitor):  # which work for it
        box.rate = min(box.rate, scenario.controller.rate)
    return scenario


def reference(time: float) -> np.ndarray:
    """Returns the controller's reference at a time (s), (18,), with a yaw of zero."""
    return np.concatenate([circle.derivatives(time).ravel(), np.zeros(3)])


def flight(scenario: Scenario):
    """Returns a flight in a scenario's world, see circle.timed()."""
    diagram = MakeFlight(scenario, reference)
    context = diagram.CreateDefaultContext()
    simulator = Simulator(diagram, context)
    start_in_flight(diagram, scenario, context, **start_on(reference))
    simulator.Initialize()
    state = diagram.GetOutputPort("truth.state")
    report = diagram.GetOutputPort("truth.referee_status")

    def fly(start, end):
        times = np.arange(round(start / LOOK) + 1, round(end / LOOK) + 1) * LOOK
        positions = []
        for time in times:
            simulator.AdvanceTo(time)
            positions.append(state.Eval(context)[4:7].copy())
        if report.Eval(context).over:
            raise RuntimeError(f"the referee ended the flight: {report.Eval(context)}")
        return times, positions

    return fly


if __name__ == "__main__":
    main()
