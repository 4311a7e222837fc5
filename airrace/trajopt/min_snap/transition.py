"""Transitions onto a circuit: from hover, and from the lap before."""

import contextlib

import numpy as np

from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.feasibility import is_feasible, passes_forward
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.flight_limits import FlightConstraints, FlightLimits
from airrace.trajopt.min_snap.circuit import LEVEL, REST_BEYOND, Circuit
from airrace.trajopt.min_snap.leg import end_constraints, trapezoid_durations
from airrace.trajopt.min_snap.min_snap import DerivativeConstraint, MinSnapProblem, solve_min_snap
from airrace.trajopt.min_snap.time_allocation import allocate_times

_APPROACHES = (None, 5.0, 10.0, 20.0)  # m before gate 1, tried in turn
_STRETCHES = (1.0, 1.02, 1.05)  # of the old lap's time, tried in turn
_LEAST_DISTANCE = 0.01  # m, from waypoint to waypoint
_MIN_DURATION = 0.1  # s, no polynomial changes laps in less


def plan_transition_from_hover(
    start: np.ndarray, circuit: Circuit, dimensions: int, constraints: FlightConstraints
) -> tuple[FlatTrajectory, float]:
    """Returns the quickest flight from hover through gate 1 and onto a circuit.

    It joins the circuit at gate 2, 3 or 4, whichever saves most time; one that rests, where it
    rests. From behind or beside gate 1 it takes a waypoint in front of it.

    Args:
        start: value and four derivatives of x, y, z (m) and yaw (rad), (5, 4).
        circuit: the lap.
        dimensions: of the lap, 3, 4 or 6, see plan_circuit().
        constraints: see plan_circuit().

    Returns: (transition, phase): and the time on the circuit at which it is joined (s).

    Raises:
        TrajectoryOptimizationError: if none is within the limits.
    """
    phases = (0.0,) if circuit.rests else circuit.gate_times[1:-1][:3]
    for approach in _APPROACHES:
        found = []
        for phase in phases:
            with contextlib.suppress(TrajectoryOptimizationError):
                transition, times = _through_gates(
                    start, circuit, dimensions, constraints.limits, phase, approach
                )
                forward = passes_forward(transition, times, circuit.headings[: len(times)])
                if forward.all() and is_feasible(transition, constraints):
                    found.append((transition, phase))
        if found:
            return min(found, key=lambda each: each[0].duration - each[1])
    raise TrajectoryOptimizationError("No transition onto the lap is within the limits.")


def transition_problem(
    start: np.ndarray,
    circuit: Circuit,
    dimensions: int,
    phase: float,
    approach: float | None = None,
) -> MinSnapProblem:
    """Returns the minimum-snap problem of a transition from hover, whose program is solved.

    Args:
        start, circuit, dimensions: see plan_transition_from_hover().
        phase: one of the circuit's gate_times, at which it is joined (s).
        approach: of a waypoint in front of gate 1 (m); None for no such waypoint.
    """
    knots, constraints, _ = _waypoints(start, circuit, dimensions, phase, approach)
    return MinSnapProblem(knots, constraints=constraints)


def _waypoints(
    start: np.ndarray, circuit: Circuit, dimensions: int, phase: float, approach: float | None
) -> tuple[np.ndarray, list[DerivativeConstraint], list[int]]:
    """Returns waypoints and constraints of a transition, and which waypoints are gates."""
    goal, yaw = circuit.derivatives(phase), circuit.headings[0]
    forward = np.array([np.cos(yaw), np.sin(yaw), 0.0, 0.0])
    knots, indices = [start[0]], []
    gate_1 = circuit.derivatives(0.0)[0] - (REST_BEYOND * forward if circuit.rests else 0.0)
    if approach is not None:
        knots.append(gate_1 - approach * forward)
    if circuit.rests:
        indices.append(len(knots))
        knots.append(gate_1)
    # The circuit's own waypoints in front of gates are passed as well.
    for t in circuit.waypoint_times[: circuit.waypoint_times.index(phase)]:
        if t in circuit.gate_times:
            indices.append(len(knots))
        knots.append(circuit.derivatives(t)[0])
    knots = np.array([*knots, goal[0]])
    knots[:, 3] = np.unwrap(knots[:, 3])
    if np.linalg.norm(np.diff(knots[:, :3], axis=0), axis=1).min() < _LEAST_DISTANCE:
        raise TrajectoryOptimizationError("Two waypoints coincide.")
    constraints = end_constraints(start, goal, (1, 2, 3, 4) if circuit.rests else (1, 2, 3))
    # Where it brakes to rest, it is level a little later.
    if dimensions == 6 and not circuit.rests:
        constraints += [DerivativeConstraint(i, 2, LEVEL) for i in indices]
    return knots, constraints, indices


def _through_gates(
    start: np.ndarray,
    circuit: Circuit,
    dimensions: int,
    limits: FlightLimits,
    phase: float,
    approach: float | None,
) -> tuple[FlatTrajectory, np.ndarray]:
    """Returns a transition that joins at a phase (s), and when it passes gates before, (n,) s."""
    knots, constraints, indices = _waypoints(start, circuit, dimensions, phase, approach)
    guess = trapezoid_durations(
        knots[:, :3], 0.0, 0.75 * limits.max_speed, 0.5 * limits.max_acceleration
    )
    durations = allocate_times(
        knots,
        constraints=constraints,
        initial_durations=guess,
        max_speed=limits.max_speed,
        max_acceleration=limits.max_acceleration,
    )
    transition = FlatTrajectory(solve_min_snap(knots, durations, constraints=constraints))
    return transition, np.array(transition.breaks)[indices]


def plan_transition_between_laps(
    start: np.ndarray, circuit: Circuit, duration: float, constraints: FlightConstraints
) -> FlatTrajectory:
    """Returns a flight from one lap's last leg onto another lap at its gate 1.

    It is the smoothest between the two states, continuous through the snap,
    by way of the circuit's own waypoint in front of gate 1, if it has one.
    Were both laps the same, it would be their last leg.

    Args:
        start: value and four derivatives of x, y, z (m) and yaw (rad), (5, 4).
        circuit: the new lap.
        duration: that the old lap takes from there to gate 1 (s).
        constraints: see plan_circuit().

    Raises:
        TrajectoryOptimizationError: if none is within the limits.
    """
    if duration < _MIN_DURATION:
        raise TrajectoryOptimizationError("It is too late for a transition to the new lap.")
    goal = circuit.derivatives(0.0)
    between = [
        t
        for t in circuit.waypoint_times
        if circuit.gate_times[-2] < t < circuit.duration
        and circuit.duration - t < duration - _MIN_DURATION  # else it lies behind
    ]
    knots = np.array([start[0], *(circuit.derivatives(t)[0] for t in between), goal[0]])
    knots[:, 3] = np.unwrap(knots[:, 3])
    times = [0.0, *(duration - circuit.duration + t for t in between), duration]
    derivatives = end_constraints(start, goal, (1, 2, 3, 4))
    for factor in _STRETCHES:
        transition = FlatTrajectory(
            solve_min_snap(knots, factor * np.diff(times), constraints=derivatives)
        )
        if is_feasible(transition, constraints):
            return transition
    raise TrajectoryOptimizationError("No transition to the new lap is within the limits.")
