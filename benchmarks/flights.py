"""Flights without a race, for experiments."""

import dataclasses as dc
import functools

import numpy as np
from pydrake.common.yaml import yaml_dump_typed
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram

from airrace.diagrams.flight import MakeFlight, start_in_flight
from airrace.scenario import Scenario, load_scenario
from airrace.systems.control.attitude_error import rotation_matrix
from airrace.systems.referee_status import RefereeStatus
from airrace.track import load_track
from airrace.trajopt.flat_trajectory import flat_outputs, hold
from airrace.trajopt.flatness import attitude_from_force, heading_vectors
from airrace.trajopt.flyable import clearance_of
from airrace.trajopt.min_snap.circuit import Circuit, plan_circuit
from airrace.trajopt.reference import as_reference
from airrace.vehicle import GRAVITY, load_vehicle

LIMITS = dict(max_speed=20.0, max_acceleration=10.0)  # of the lap (m/s, m/s^2)
PERIOD = 0.01  # s, between two looks at a flight


@dc.dataclass(frozen=True)
class Flown:
    """What was seen of a flight.

    Attributes:
        times: of the looks, (N,) s.
        states: at those: quaternion of R_WB, p_WB, w_WB, v_WB, (N, 13).
        losses: when each rotor was found to be lost (s), at the end.
        report: the referee's, at the end.
    """

    times: np.ndarray
    states: np.ndarray
    losses: np.ndarray
    report: RefereeStatus

    @property
    def rotations(self) -> np.ndarray:
        """R_WB, (N, 3, 3)."""
        return np.array([rotation_matrix(*state[:4].tolist()) for state in self.states])

    @property
    def tilts(self) -> np.ndarray:
        """Angles between thrust axis and the vertical, (N,) degrees."""
        return np.rad2deg(np.arccos(np.clip(self.rotations[:, 2, 2], -1.0, 1.0)))


def fly(scenario, reference, duration, **start) -> Flown:
    """Flies along a reference until the time is over or the referee ends it.

    Args:
        scenario: of MakeFlight().
        reference: of MakeFlight().
        duration: (s).
        start: X_WB, w_WB and v_WB of start_in_flight().
    """
    flight, simulator = _built(yaml_dump_typed(scenario, schema=Scenario), reference)
    context = flight.CreateDefaultContext()
    simulator.reset_context(context)
    start_in_flight(flight, scenario, context, **start)
    simulator.Initialize()
    names = ("truth.state", "truth.referee_status", "rotor_losses")
    state, report, losses = (flight.GetOutputPort(name) for name in names)
    states = []
    while len(states) < round(duration / PERIOD):
        simulator.AdvanceTo((len(states) + 1) * PERIOD)
        if report.Eval(context).over:
            break
        states.append(state.Eval(context).copy())
    return Flown(
        times=PERIOD * np.arange(1, len(states) + 1),
        states=np.array(states),
        losses=losses.Eval(context).copy(),
        report=report.Eval(context),
    )


@functools.lru_cache(maxsize=4)  # it takes as long as seconds of flight
def _built(scenario_text: str, reference) -> tuple[Diagram, Simulator]:
    """Returns the flight of a scenario along a reference, and its simulator."""
    flight = MakeFlight(load_scenario(scenario_text=scenario_text), reference)
    return flight, Simulator(flight)


@functools.cache
def racing_lap(drone: str) -> Circuit:
    """Returns the 3-D lap of a drone through the true gates of the reference track."""
    track = load_track("student-airrace")
    return plan_circuit(
        [gate.p_WG for gate in track.gates],
        [gate.heading for gate in track.gates],
        track.pylons()[:, :2],
        3,
        clearance=clearance_of(load_vehicle(drone)[0].radius),
        **LIMITS,
    )


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
    r = as_reference(reference(0.0))
    force = r.acceleration + [0.0, 0.0, GRAVITY]
    axes, w, _ = attitude_from_force(
        force,
        r.jerk,
        r.snap,
        heading_vectors(np.cos(r.yaw), np.sin(r.yaw), r.yaw_rate, r.yaw_acceleration),
    )
    R_WB = np.column_stack(axes)
    return dict(
        X_WB=RigidTransform(RotationMatrix(R_WB), r.position), w_WB=R_WB @ w, v_WB=r.velocity
    )


def deviations(flown: Flown, reference) -> np.ndarray:
    """Returns the distances from a reference, (N,) m."""
    desired = np.array([as_reference(reference(time)).position for time in flown.times])
    return np.linalg.norm(flown.states[:, 4:7] - desired, axis=1)
