"""The ways onto a circuit: from hover, and from the lap before."""

import contextlib

import numpy as np

from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.flight_limits import FlightLimits
from airrace.trajopt.flyable import is_flyable, passes_forward
from airrace.trajopt.gate_regions import unwrap_headings
from airrace.trajopt.min_snap.circuit import LEVEL, Circuit
from airrace.trajopt.min_snap.leg import end_constraints, trapezoid_durations
from airrace.trajopt.min_snap.min_snap import DerivativeConstraint, solve_min_snap
from airrace.trajopt.min_snap.time_allocation import allocate_times

_APPROACHES = (None, 5.0, 10.0, 20.0)  # m before gate 1, tried in turn
_STRETCHES = (1.0, 1.02, 1.05)  # of the old lap's time, tried in turn
_LEAST_DISTANCE = 0.01  # m, from waypoint to waypoint
_LEAST_CHANGE = 0.1  # s, no polynomial changes laps in less


def plan_start(
    start,
    circuit: Circuit,
    dimensions,
    pylons,
    *,
    clearance,
    max_speed,
    max_acceleration,
    rotors: FlightLimits | None = None,
) -> tuple[FlatTrajectory, float]:
    """Returns the quickest flight from hover through gate 1 and onto a circuit.

    It joins the circuit at gate 2, 3 or 4, whichever saves most time. From
    behind or beside gate 1 it takes a waypoint in front of it.

    Args:
        start: value and four derivatives of x, y, z (m) and yaw (rad), (5, 4).
        circuit: the lap.
        dimensions: of the lap, 3, 4 or 6, see plan_circuit().
        pylons: axes to keep clear of, [x, y], (n, 2) m.
        clearance: from those, a number or (n,) m.
        max_speed, max_acceleration, rotors: see plan_circuit().

    Returns:
        (entry, phase): and the time on the circuit at which it is joined (s).

    Raises:
        TrajectoryOptimizationError: if none is within the limits.
    """
    limits = dict(max_speed=max_speed, max_acceleration=max_acceleration)
    for approach in _APPROACHES:
        starts = []
        for gates in range(1, min(4, len(circuit.headings))):
            with contextlib.suppress(TrajectoryOptimizationError):
                entry, times = _solve_start(start, circuit, gates, approach, dimensions, limits)
                forward = passes_forward(entry, times, circuit.headings[:gates])
                if forward.all() and is_flyable(
                    entry, pylons, clearance=clearance, rotors=rotors, **limits
                ):
                    starts.append((entry, circuit.gate_times[gates]))
        if starts:
            return min(starts, key=lambda s: s[0].duration - s[1])
    raise TrajectoryOptimizationError("No start onto the lap is within the limits.")


def _solve_start(start, circuit: Circuit, gates, approach, dimensions, limits):
    """Returns an entry through some gates, and when it passes them, (gates,) s."""
    phase = circuit.gate_times[gates]
    goal = circuit.derivatives(phase)
    knots = [start[0]]
    if approach is not None:
        yaw = circuit.headings[0]
        forward = np.array([np.cos(yaw), np.sin(yaw), 0.0, 0.0])
        knots.append(circuit.derivatives(0.0)[0] - approach * forward)
    # The circuit's own waypoints in front of gates are passed as well.
    indices = []
    for t in circuit.waypoint_times[: circuit.waypoint_times.index(phase)]:
        if t in circuit.gate_times:
            indices.append(len(knots))
        knots.append(circuit.derivatives(t)[0])
    knots = np.array([*knots, goal[0]])
    knots[:, 3] = unwrap_headings(knots[:, 3])
    if np.linalg.norm(np.diff(knots[:, :3], axis=0), axis=1).min() < _LEAST_DISTANCE:
        raise TrajectoryOptimizationError("Two waypoints coincide.")
    constraints = end_constraints(start, goal, (1, 2, 3))
    if dimensions == 6:
        constraints += [DerivativeConstraint(i, 2, LEVEL) for i in indices]
    guess = trapezoid_durations(
        knots[:, :3], 0.0, 0.75 * limits["max_speed"], 0.5 * limits["max_acceleration"]
    )
    durations = allocate_times(knots, constraints=constraints, initial_durations=guess, **limits)
    entry = FlatTrajectory(solve_min_snap(knots, durations, constraints=constraints))
    return entry, np.array(entry.breaks)[indices]


def plan_change(
    start,
    circuit: Circuit,
    duration,
    pylons,
    *,
    clearance,
    max_speed,
    max_acceleration,
    rotors: FlightLimits | None = None,
) -> FlatTrajectory:
    """Returns a flight from one lap's last leg onto another lap at its gate 1.

    It is the smoothest between the two states, continuous through the snap,
    by way of the circuit's own waypoint in front of gate 1, if it has one.
    Were both laps the same, it would be their last leg.

    Args:
        start: value and four derivatives of x, y, z (m) and yaw (rad), (5, 4).
        circuit: the new lap.
        duration: that the old lap takes from there to gate 1 (s).
        pylons: axes to keep clear of, [x, y], (n, 2) m.
        clearance: from those, a number or (n,) m.
        max_speed, max_acceleration, rotors: see plan_circuit().

    Raises:
        TrajectoryOptimizationError: if none is within the limits.
    """
    if duration < _LEAST_CHANGE:
        raise TrajectoryOptimizationError("It is too late for a change to the new lap.")
    goal = circuit.derivatives(0.0)
    between = [
        t
        for t in circuit.waypoint_times
        if circuit.gate_times[-2] < t < circuit.duration
        and circuit.duration - t < duration - _LEAST_CHANGE  # else it lies behind
    ]
    knots = np.array([start[0], *(circuit.derivatives(t)[0] for t in between), goal[0]])
    knots[:, 3] = unwrap_headings(knots[:, 3])
    times = [0.0, *(duration - circuit.duration + t for t in between), duration]
    constraints = end_constraints(start, goal, (1, 2, 3, 4))
    for factor in _STRETCHES:
        change = FlatTrajectory(
            solve_min_snap(knots, factor * np.diff(times), constraints=constraints)
        )
        if is_flyable(
            change,
            pylons,
            clearance=clearance,
            max_speed=max_speed,
            max_acceleration=max_acceleration,
            rotors=rotors,
        ):
            return change
    raise TrajectoryOptimizationError("No change to the new lap is within the limits.")
