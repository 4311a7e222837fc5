"""Flights along a reference in the simulated world, without a race."""

import dataclasses as dc
import functools

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.common.yaml import yaml_dump_typed
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram
from scipy.spatial.transform import Rotation

from airrace.diagrams.reference_flight import MakeFlight, start_in_flight
from airrace.scenario import Scenario, load_scenario
from airrace.systems.types import RefereeStatus
from airrace.trajopt.feasibility import clearance_of
from airrace.trajopt.flat_trajectory import flat_outputs, hold
from airrace.trajopt.flight_limits import FlightConstraints, FlightLimits
from airrace.trajopt.min_snap.circuit import Circuit, plan_circuit
from airrace.trajopt.reference import as_reference
from airrace.vehicle import load_vehicle
from airrace.vehicle.state import as_plant_state, as_state
from tests.worlds.kinematic_flight import flat_state
from tests.worlds.published_laps import ORIGINAL, load_course

PERIOD = 0.01  # s, between two samples of a flight


@dc.dataclass(frozen=True)
class Flown:
    """What happened in a flight.

    Attributes:
        times: of the samples, (N,) s.
        rotations: R_WB, (N, 3, 3).
        positions: p_WB, (N, 3) m.
        angular_velocities: w_WB in the world, (N, 3) rad/s.
        velocities: v_WB, (N, 3) m/s.
        losses: when each rotor was found to be lost (s), at the end.
        status: the referee's, at the end.
    """

    times: np.ndarray
    rotations: np.ndarray
    positions: np.ndarray
    angular_velocities: np.ndarray
    velocities: np.ndarray
    losses: np.ndarray
    status: RefereeStatus

    @property
    def speeds(self) -> np.ndarray:
        """(N,) m/s."""
        return np.linalg.norm(self.velocities, axis=1)

    @property
    def tilts(self) -> np.ndarray:
        """Angles between thrust axis and the vertical, (N,) degrees."""
        return np.rad2deg(np.arccos(np.clip(self.rotations[:, 2, 2], -1.0, 1.0)))


def fly(scenario, reference, duration, *, down_to=None, **start) -> Flown:
    """Flies along a reference until the time is over, or the drone is down.

    Args:
        scenario: of MakeFlight().
        reference: of MakeFlight().
        duration: (s).
        down_to: the height at which the flight ends (m), whatever was touched on the way; None:
            the referee ends it.
        start: X_WB, w_WB and v_WB of start_in_flight().
    """
    flight, simulator = _built(yaml_dump_typed(scenario, schema=Scenario), reference)
    context = flight.CreateDefaultContext()
    simulator.reset_context(context)
    start_in_flight(flight, scenario, context, **start)
    simulator.Initialize()
    names = ("truth.state", "truth.referee_status", "rotor_losses")
    state, status, losses = (flight.GetOutputPort(name) for name in names)
    states = []
    while len(states) < round(duration / PERIOD):
        simulator.AdvanceTo((len(states) + 1) * PERIOD)
        if down_to is None and status.Eval(context).over:
            break
        states.append(state.Eval(context).copy())
        if down_to is not None and as_plant_state(states[-1]).position[2] < down_to:
            break
    flown = as_plant_state(np.reshape(states, (-1, 13)).T)
    return Flown(
        times=PERIOD * np.arange(1, len(states) + 1),
        rotations=Rotation.from_quat(flown.quaternion.T, scalar_first=True).as_matrix(),
        positions=flown.position.T,
        angular_velocities=flown.angular_velocity.T,
        velocities=flown.velocity.T,
        losses=losses.Eval(context).copy(),
        status=status.Eval(context),
    )


@functools.lru_cache(maxsize=4)  # it takes as long as seconds of flight
def _built(scenario_text: str, reference) -> tuple[Diagram, Simulator]:
    """Returns the flight of a scenario along a reference, and its simulator."""
    flight = MakeFlight(load_scenario(scenario_text=scenario_text), reference)
    return flight, Simulator(flight)


@functools.cache
def racing_lap(drone: str) -> Circuit:
    """Returns the 3-D lap of a drone through the true gates of the track student-airrace."""
    vehicle = load_vehicle(drone)[0]
    midpoints, headings, pylons = load_course()
    constraints = FlightConstraints(
        pylons, clearance_of(vehicle.radius), FlightLimits(vehicle, **ORIGINAL)
    )
    return plan_circuit(midpoints, headings, 3, constraints)


@functools.cache
def lap_reference(lap: Circuit, phase: float):
    """Returns the reference of lap after lap, from a share of the first on."""

    def reference(time):
        return flat_outputs(lap.derivatives((time + phase * lap.duration) % lap.duration))

    return reference


@functools.cache
def hover_reference(height: float):
    """Returns the reference of hovering over the world's origin (m)."""
    pose = hold([0.0, 0.0, height], 0.0)
    return lambda time: pose


def start_on(reference) -> dict:
    """Returns the start of a drone that is on a reference, see fly()."""
    state = as_state(flat_state(reference(0.0), 0.0))
    return dict(
        X_WB=RigidTransform(RotationMatrix(Quaternion(state.quaternion)), state.position),
        w_WB=state.angular_velocity,
        v_WB=state.velocity,
    )


def deviations(flown: Flown, reference) -> np.ndarray:
    """Returns the distances from a reference, (N,) m."""
    desired = np.array([as_reference(reference(time)).position for time in flown.times])
    return np.linalg.norm(flown.positions - desired, axis=1)
