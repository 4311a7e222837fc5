"""The lap: a closed trajectory through the gates, and how to get onto it."""

import numpy as np
from pydrake.trajectories import PiecewisePolynomial

from airrace.trajopt.flat_trajectory import ACCELERATION, VELOCITY, FlatTrajectory
from airrace.trajopt.min_snap import (
    DerivativeConstraint,
    TrajectoryOptimizationError,
    solve_min_snap,
    turn_per_lap,
    unwrap_headings,
)
from airrace.trajopt.time_allocation import allocate_times

_LOWEST = 1.0  # m, the least height of an entry
_SAMPLES = 200


def plan_circuit(midpoints, headings, dimensions, *, max_speed, max_acceleration,
                 initial_durations=None) -> FlatTrajectory:
    """Returns the lap through the gates that is shortest within the limits.

    Section V of the Student AirRace report, as a closed loop: nobody stops at
    gate 1. In three dimensions only x, y, z are planned and yaw stays at the
    heading of gate 1; in four, yaw follows the gates' headings; in six, roll
    and pitch are zero at each gate as well. By differential flatness (Mellinger
    and Kumar, ICRA 2011) these are zero where the horizontal acceleration is.

    Args:
        midpoints: of the gates, (n, 3) m.
        headings: of the gates, (n,) rad.
        dimensions: 3, 4 or 6.
        max_speed, max_acceleration: (m/s), (m/s^2).
        initial_durations: (n,) s, of a similar lap, to start from.

    Raises:
        TrajectoryOptimizationError: if there is no such lap.
    """
    waypoints = np.array(midpoints, float)
    headings = unwrap_headings(headings)
    offset = np.zeros(3)
    if dimensions > 3:
        waypoints = np.column_stack([waypoints, headings])
        offset = np.array([0.0, 0.0, 0.0, turn_per_lap(headings)])
    constraints = []
    if dimensions == 6:
        level = np.array([0.0, 0.0, np.nan, np.nan])
        constraints = [DerivativeConstraint(i, 2, level) for i in range(len(waypoints))]
    problem = dict(constraints=constraints, periodic=True, period_offset=offset)
    durations = allocate_times(
        waypoints, max_speed=max_speed, max_acceleration=max_acceleration,
        initial_durations=initial_durations, **problem,
    )
    lap = solve_min_snap(waypoints, durations, **problem)
    if dimensions == 3:
        breaks = lap.get_segment_times()
        yaw = PiecewisePolynomial.ZeroOrderHold(breaks, np.full((1, len(breaks)), headings[0]))
        lap = _stack(lap, yaw)
    return FlatTrajectory(lap)


def plan_entry(start, circuit: FlatTrajectory, *, max_speed, max_acceleration) -> FlatTrajectory:
    """Returns the quickest single polynomial onto a circuit at gate 1.

    Args:
        start: value and derivatives of x, y, z (m) and yaw (rad), (>= 4, 4).
        circuit: the lap; its start is joined through the jerk.
        max_speed, max_acceleration: (m/s), (m/s^2).

    Raises:
        TrajectoryOptimizationError: if none is within the limits.
    """
    goal = circuit.derivatives(0.0, 4).copy()
    goal[0, 3] += 2 * np.pi * np.round((start[0, 3] - goal[0, 3]) / (2 * np.pi))
    knots = np.array([start[0], goal[0]])
    constraints = [
        DerivativeConstraint(i, order, side[order])
        for i, side in ((0, start), (-1, goal))
        for order in (1, 2, 3)
    ]
    shortest = np.linalg.norm(goal[0, :3] - start[0, :3]) / max_speed
    for factor in 1.03 ** np.arange(100):
        entry = FlatTrajectory(
            solve_min_snap(knots, [factor * max(shortest, 0.2)], constraints=constraints)
        )
        samples = entry.sample(np.linspace(0.0, entry.duration, _SAMPLES))
        speed, acceleration = peaks(samples)
        if (
            speed <= max_speed
            and acceleration <= max_acceleration
            and samples[2].min() >= min(_LOWEST, start[0, 2])
        ):
            return entry
    raise TrajectoryOptimizationError("No entry to the lap is within the limits.")


def peaks(samples) -> tuple[float, float]:
    """Returns the largest speed and acceleration of samples (18, N) (m, s)."""
    return (
        float(np.linalg.norm(samples[VELOCITY], axis=0).max()),
        float(np.linalg.norm(samples[ACCELERATION], axis=0).max()),
    )


def _stack(upper, lower):
    """Returns the trajectory with the rows of both; their breaks are equal."""
    polynomials = [
        np.vstack([upper.getPolynomialMatrix(i), lower.getPolynomialMatrix(i)])
        for i in range(upper.get_number_of_segments())
    ]
    return PiecewisePolynomial(polynomials, upper.get_segment_times())
