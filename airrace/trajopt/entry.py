"""The ways onto a circuit: from hover, and from the lap before."""

import contextlib

import numpy as np

from airrace.trajopt.circuit import LEVEL, Circuit
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.flyable import is_flyable
from airrace.trajopt.leg import trapezoid_durations
from airrace.trajopt.min_snap import (
    DerivativeConstraint,
    TrajectoryOptimizationError,
    solve_min_snap,
    unwrap_headings,
)
from airrace.trajopt.time_allocation import allocate_times

_STRETCHES = (1.0, 1.02, 1.05)  # of the old lap's time, tried in turn


def plan_start(start, circuit: Circuit, dimensions, pylons, *, max_speed,
               max_acceleration) -> tuple[FlatTrajectory, float]:
    """Returns the quickest flight from hover through gate 1 and onto a circuit.

    It joins the circuit at gate 2, 3 or 4, whichever saves most time.

    Args:
        start: value and four derivatives of x, y, z (m) and yaw (rad), (5, 4).
        circuit: the lap.
        dimensions: of the lap, 3, 4 or 6, see plan_circuit().
        pylons: axes to keep clear of, [x, y], (n, 2) m.
        max_speed, max_acceleration: (m/s), (m/s^2).

    Returns:
        (entry, phase): and the time on the circuit at which it is joined (s).

    Raises:
        TrajectoryOptimizationError: if none is within the limits.
    """
    limits = dict(max_speed=max_speed, max_acceleration=max_acceleration)
    best, best_time = None, np.inf
    for gates in range(1, min(4, len(circuit.gate_times) - 1)):
        phase = circuit.gate_times[gates]
        between = [circuit.derivatives(t)[0] for t in circuit.gate_times[:gates]]
        goal = circuit.derivatives(phase)
        knots = np.vstack([start[0], between, goal[0]])
        knots[:, 3] = unwrap_headings(knots[:, 3])
        constraints = _end_constraints(start, goal, (1, 2, 3))
        if dimensions == 6:
            constraints += [DerivativeConstraint(i, 2, LEVEL) for i in range(1, gates + 1)]
        with contextlib.suppress(TrajectoryOptimizationError):
            durations = allocate_times(
                knots, constraints=constraints, **limits,
                initial_durations=trapezoid_durations(
                    knots[:, :3], 0.0, 0.75 * max_speed, 0.5 * max_acceleration
                ),
            )
            entry = FlatTrajectory(solve_min_snap(knots, durations, constraints=constraints))
            time = entry.duration - phase
            if time < best_time and is_flyable(entry, pylons, **limits):
                best, best_time = (entry, phase), time
    if best is None:
        raise TrajectoryOptimizationError("No start onto the lap is within the limits.")
    return best


def plan_change(start, circuit: Circuit, duration, pylons, *, max_speed,
                max_acceleration) -> FlatTrajectory:
    """Returns a flight from one lap's last leg onto another lap at its gate 1.

    It is the one polynomial of degree 9 between the two states, continuous
    through the snap. Were both laps the same, it would be their last leg.

    Args:
        start: value and four derivatives of x, y, z (m) and yaw (rad), (5, 4).
        circuit: the new lap.
        duration: that the old lap takes from there to gate 1 (s).
        pylons: axes to keep clear of, [x, y], (n, 2) m.
        max_speed, max_acceleration: (m/s), (m/s^2).

    Raises:
        TrajectoryOptimizationError: if none is within the limits.
    """
    goal = circuit.derivatives(0.0)
    goal[0, 3] += 2 * np.pi * np.round((start[0, 3] - goal[0, 3]) / (2 * np.pi))
    knots = np.array([start[0], goal[0]])
    constraints = _end_constraints(start, goal, (1, 2, 3, 4))
    for factor in _STRETCHES:
        change = FlatTrajectory(
            solve_min_snap(knots, [factor * duration], constraints=constraints)
        )
        if is_flyable(
            change, pylons, max_speed=max_speed, max_acceleration=max_acceleration
        ):
            return change
    raise TrajectoryOptimizationError("No change to the new lap is within the limits.")


def _end_constraints(start, goal, orders):
    return [
        DerivativeConstraint(i, order, side[order])
        for i, side in ((0, start), (-1, goal))
        for order in orders
    ]
