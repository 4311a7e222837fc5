"""The Default drone on the circle, under its geometric controller.

.venv/bin/python -m benchmarks.peers.fly_airrace
"""

from importlib.metadata import version

import numpy as np
from pydrake.systems.analysis import Simulator

from airrace.diagrams.reference_flight import MakeFlight, start_in_flight
from airrace.scenario import Scenario
from benchmarks.peers import circle
from tests.worlds.flight import PERIOD, start_on

_RATES = (100, 500)  # Hz, of the controller: the peers'; the last is the default, too


def main() -> None:
    """Flies at each rate."""
    circle.on_one_core()
    circle.report(f"airrace, Drake {version('drake')}", [row(rate) for rate in _RATES])


def row(rate: int) -> dict:
    """Returns what circle.timed() says of a flight at a rate of the controller (Hz)."""
    scenario = Scenario()
    scenario.controller.rate = float(rate)
    for config in (scenario.state_filter, scenario.rotor_monitor):  # which feed the controller
        config.rate = min(config.rate, scenario.controller.rate)
    return circle.timed(
        flight(scenario),
        controller="GeometricController",
        besides="contact, referee, noise of the state, filter, rotor monitor",
        position_hz=rate,
        attitude_hz=rate,
        physics_hz=round(1.0 / scenario.plant_config.time_step),
        integrator="MultibodyPlant",
    )


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
    status = diagram.GetOutputPort("truth.referee_status")

    def fly(start, end):
        times = np.arange(round(start / PERIOD) + 1, round(end / PERIOD) + 1) * PERIOD
        positions = []
        for time in times:
            simulator.AdvanceTo(time)
            positions.append(state.Eval(context)[4:7].copy())
        if status.Eval(context).over:
            raise RuntimeError(f"the referee ended the flight: {status.Eval(context)}")
        return times, positions

    return fly


if __name__ == "__main__":
    main()
