"""The circuit: a closed lap through the gates of a map."""

import contextlib
import dataclasses as dc
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike
from pydrake.trajectories import PiecewisePolynomial

from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.feasibility import (
    check_flight,
    is_feasible,
    passes_forward,
    pylon_distances,
    sample_times,
)
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.flight_limits import FlightConstraints, FlightLimits
from airrace.trajopt.gate_regions import GateRegions, turn_per_lap
from airrace.trajopt.min_snap.min_snap import DerivativeConstraint, solve_min_snap
from airrace.trajopt.min_snap.time_allocation import allocate_times

LEVEL = np.array([0.0, 0.0, np.nan, np.nan])  # no horizontal acceleration
# Of the limits, so that a slightly different transition onto the circuit keeps them.
_MARGIN = 0.99
_APPROACHES = (None, 5.0, 3.0, 2.0, 10.0)  # m before a gate, tried in turn
_MOST_ROUNDS = 4  # of each, with the gates that were faulty in the last
_MOST_SLOWING = 20.0  # times the durations within limits of speed and acceleration


class Circuit(FlatTrajectory):
    """One lap from gate 1 to gate 1.

    Attributes:
        gate_times: when each gate is passed (s), then the duration.
        headings: of the gates (rad), as a tuple.
        approach: gate index to distance (m) of a waypoint in front of it.
    """

    def __init__(
        self,
        polynomial: PiecewisePolynomial,
        gate_times: Sequence[float],
        headings: np.ndarray,
        approach: dict,
    ):
        """Args: polynomial: with four rows. The others: see above."""
        super().__init__(polynomial)
        self.gate_times = tuple(gate_times)
        self.headings = tuple(headings)
        self.approach = approach

    @property
    def waypoint_times(self) -> tuple:
        """When gates and waypoints in front of them are passed, then the duration (s)."""
        return self.breaks


def plan_circuit(
    midpoints: ArrayLike,
    headings: ArrayLike,
    dimensions: int,
    constraints: FlightConstraints,
    *,
    previous: Circuit | None = None,
) -> Circuit:
    """Returns the lap through the gates that is shortest within the limits.

    Section V of the Student AirRace report, as a closed loop: nobody stops at
    gate 1. In three dimensions only x, y, z are planned and yaw stays at the
    heading of gate 1; in four, yaw follows the gates' headings; in six, roll
    and pitch are zero at each gate as well. By differential flatness (Mellinger
    and Kumar, ICRA 2011) these are zero where the horizontal acceleration is.

    Between midpoints alone, the shortest lap may slip through a gate sideways,
    along its pylons. Such a gate gets a waypoint straight in front of it.

    Args:
        midpoints: of the gates, (n, 3) m.
        headings: of the gates, (n,) rad.
        dimensions: 3, 4 or 6.
        constraints: of finite speed and acceleration. If there is a vehicle, the lap is
            slowed until its rotors can fly it.
        previous: the lap through a similar map, to start from.

    Raises:
        TrajectoryOptimizationError: if there is no such lap.
    """
    limits = constraints.limits
    regions = GateRegions.balls(midpoints, headings, 0.0)
    gates = np.column_stack([regions.midpoints, regions.headings])
    if previous is not None and len(previous.headings) == len(gates):
        with contextlib.suppress(TrajectoryOptimizationError):
            durations = np.diff(previous.breaks)
            circuit = _solve(gates, previous.approach, dimensions, durations, limits)
            faults = _faults(circuit, constraints)
            if not faults and is_feasible(circuit, constraints):
                return circuit
    faults = set()
    for distance in _APPROACHES:
        # A waypoint in front of one gate may lead to another minimum, with faults elsewhere.
        for _ in range(_MOST_ROUNDS):
            approach = {} if distance is None else dict.fromkeys(sorted(faults), distance)
            try:
                circuit = _solve(gates, approach, dimensions, None, limits)
            except TrajectoryOptimizationError:
                break
            new_faults = _faults(circuit, constraints)
            if not new_faults and is_feasible(circuit, constraints):
                return circuit
            settled = distance is None or new_faults <= faults
            faults |= new_faults
            if settled:
                break
        if not faults:
            break  # there is nothing to try
    raise TrajectoryOptimizationError("No lap is within the limits and clear of all pylons.")


def _solve(
    gates: np.ndarray,
    approach: dict,
    dimensions: int,
    durations: np.ndarray | None,
    limits: FlightLimits,
) -> Circuit:
    """Returns the shortest lap with some waypoints in front of gates."""
    waypoints, indices = [], []
    legs = np.linalg.norm(gates[:, :3] - np.roll(gates[:, :3], 1, axis=0), axis=1)
    for i, (gate, leg) in enumerate(zip(gates, legs)):
        if i in approach:
            forward = np.array([np.cos(gate[3]), np.sin(gate[3]), 0.0, 0.0])
            waypoints.append(gate - min(approach[i], leg / 2) * forward)
        indices.append(len(waypoints))
        waypoints.append(gate)
    turn = np.array([0.0, 0.0, 0.0, turn_per_lap(gates[:, 3])])
    # The lap starts at gate 1, its approach comes last.
    if indices[0] > 0:
        waypoints = [*waypoints[1:], waypoints[0] + turn]
        indices = [i - 1 for i in indices]
    waypoints = np.array(waypoints)
    if dimensions == 3:
        waypoints[:, 3], turn = gates[0, 3], np.zeros(4)
    level = indices if dimensions == 6 else ()
    constraints = [DerivativeConstraint(i, 2, LEVEL) for i in level]
    problem = dict(constraints=constraints, periodic=True, period_offset=turn)
    durations = allocate_times(
        waypoints,
        initial_durations=durations,
        max_speed=_MARGIN * limits.max_speed,
        max_acceleration=_MARGIN * limits.max_acceleration,
        **problem,
    )

    def lap(factor):
        path = solve_min_snap(waypoints, factor * durations, **problem)
        breaks = np.array(path.get_segment_times())
        return Circuit(path, [*breaks[indices], breaks[-1]], gates[:, 3], approach)

    return lap(1.0) if limits.vehicle is None else _slowed(lap, limits)


def _slowed(lap: Callable[[float], Circuit], limits: FlightLimits) -> Circuit:
    """Returns lap(factor) with the least factor, 1 or more, that the rotors can fly."""
    limits = dc.replace(limits, thrust_share=_MARGIN * limits.thrust_share)

    def excess(factor):
        circuit = lap(factor)
        return check_flight(circuit.sample(sample_times(circuit)), (), limits).excess

    low = high = 1.0
    while excess(high) > 0.0:
        low, high = high, 1.1 * high
        if high > _MOST_SLOWING:
            raise TrajectoryOptimizationError("The rotors cannot fly the lap, however slow.")
    while high - low > 1e-4 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if excess(middle) > 0.0 else (low, middle)
    return lap(high)


def _faults(circuit: Circuit, constraints: FlightConstraints) -> set:
    """Returns the gates that are passed sideways or nearest to where a pylon is too near."""
    gate_times = np.array(circuit.gate_times)
    forward = passes_forward(circuit, gate_times[:-1], circuit.headings)
    times = sample_times(circuit)
    distances = pylon_distances(circuit.sample(times), constraints.pylons)
    near = (distances < constraints.clearance).any(axis=1)
    nearest = np.abs(times[near, None] - gate_times).argmin(axis=1) % len(forward)
    return {*np.flatnonzero(~forward).tolist(), *nearest.tolist()}
