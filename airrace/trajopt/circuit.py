"""The circuit: a closed lap through the gates of a map."""

import numpy as np
from pydrake.trajectories import PiecewisePolynomial

from airrace.trajopt.flat_trajectory import VELOCITY, FlatTrajectory
from airrace.trajopt.flyable import CLEARANCE, is_flyable, pylon_distances, sample_times
from airrace.trajopt.min_snap import (
    DerivativeConstraint,
    TrajectoryOptimizationError,
    solve_min_snap,
    turn_per_lap,
    unwrap_headings,
)
from airrace.trajopt.time_allocation import allocate_times

LEVEL = np.array([0.0, 0.0, np.nan, np.nan])  # no horizontal acceleration
# Of the limits, so that a slightly different way onto the circuit keeps them.
_MARGIN = 0.99
_MAX_CROSSING_ANGLE = np.deg2rad(60.0)
_APPROACHES = (None, 5.0, 3.0, 2.0)  # m before a gate, tried in turn


class Circuit(FlatTrajectory):
    """One lap from gate 1 to gate 1.

    Attributes:
        gate_times: when each gate is passed (s), then the duration.
        approach: gate index to distance (m) of a waypoint in front of it.
    """

    def __init__(self, polynomial: PiecewisePolynomial, gate_times, approach: dict):
        """Args: polynomial: with four rows. gate_times, approach: see above."""
        super().__init__(polynomial)
        self.gate_times = tuple(gate_times)
        self.approach = approach


def plan_circuit(midpoints, headings, pylons, dimensions, *, max_speed, max_acceleration,
                 previous: Circuit | None = None) -> Circuit:
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
        pylons: axes to keep clear of, [x, y], (m, 2) m.
        dimensions: 3, 4 or 6.
        max_speed, max_acceleration: (m/s), (m/s^2).
        previous: the lap through a similar map, to start from.

    Raises:
        TrajectoryOptimizationError: if there is no such lap.
    """
    limits = dict(max_speed=max_speed, max_acceleration=max_acceleration)
    gates = np.column_stack([midpoints, unwrap_headings(headings)])
    if previous is not None and len(previous.gate_times) == len(gates) + 1:
        circuit = _solve(gates, previous.approach, dimensions, np.diff(previous.breaks), limits)
        if not _faults(circuit, gates, pylons) and is_flyable(circuit, pylons, **limits):
            return circuit
    faults = set()
    for distance in _APPROACHES:
        circuit = _solve(gates, {i: distance for i in sorted(faults)}, dimensions, None, limits)
        new_faults = _faults(circuit, gates, pylons)
        if not new_faults and is_flyable(circuit, pylons, **limits):
            return circuit
        faults |= new_faults
    raise TrajectoryOptimizationError("No lap is within the limits and clear of all pylons.")


def _solve(gates, approach, dimensions, durations, limits) -> Circuit:
    """Returns the shortest lap with some waypoints in front of gates."""
    waypoints, indices = [], []
    for i, gate in enumerate(gates):
        if i in approach:
            forward = np.array([np.cos(gate[3]), np.sin(gate[3]), 0.0, 0.0])
            waypoints.append(gate - approach[i] * forward)
        indices.append(len(waypoints))
        waypoints.append(gate)
    # The lap starts at gate 1, its approach comes last.
    if indices[0] > 0:
        turn = [0.0, 0.0, 0.0, turn_per_lap(gates[:, 3])]
        waypoints = [*waypoints[1:], waypoints[0] + turn]
        indices = [i - 1 for i in indices]
    size = 3 if dimensions == 3 else 4
    waypoints = np.array(waypoints)[:, :size]
    offset = np.array([0.0, 0.0, 0.0, turn_per_lap(gates[:, 3])])[:size]
    constraints = []
    if dimensions == 6:
        constraints = [DerivativeConstraint(i, 2, LEVEL) for i in indices]
    problem = dict(constraints=constraints, periodic=True, period_offset=offset)
    durations = allocate_times(
        waypoints, initial_durations=durations,
        **{name: _MARGIN * limit for name, limit in limits.items()}, **problem,
    )
    lap = solve_min_snap(waypoints, durations, **problem)
    breaks = np.array(lap.get_segment_times())
    if dimensions == 3:
        yaw = PiecewisePolynomial.ZeroOrderHold(breaks, np.full((1, len(breaks)), gates[0, 3]))
        lap = _stack(lap, yaw)
    return Circuit(lap, [*breaks[indices], breaks[-1]], approach)


def _faults(circuit: Circuit, gates, pylons) -> set:
    """Returns the gates that are passed sideways or with a pylon on the way."""
    forward = np.column_stack([np.cos(gates[:, 3]), np.sin(gates[:, 3]), np.zeros(len(gates))])
    velocity = circuit.sample(circuit.gate_times[:-1])[VELOCITY].T
    along = np.sum(forward * velocity, axis=1)
    slanted = along < np.cos(_MAX_CROSSING_ANGLE) * np.linalg.norm(velocity, axis=1)
    times = sample_times(circuit)
    near = pylon_distances(circuit.sample(times), pylons).min(axis=1, initial=np.inf) < CLEARANCE
    leg = np.searchsorted(circuit.gate_times, times[near], side="right") - 1
    return {*np.flatnonzero(slanted).tolist(), *((leg + 1) % len(gates)).tolist()}


def _stack(upper, lower):
    """Returns the trajectory with the rows of both; their breaks are equal."""
    polynomials = [
        np.vstack([upper.getPolynomialMatrix(i), lower.getPolynomialMatrix(i)])
        for i in range(upper.get_number_of_segments())
    ]
    return PiecewisePolynomial(polynomials, upper.get_segment_times())
