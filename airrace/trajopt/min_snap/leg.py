"""A smooth flight through a few waypoints that ends at rest."""

import contextlib
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.min_snap.min_snap import DerivativeConstraint, MinSnapProblem, solve_min_snap
from airrace.trajopt.min_snap.time_allocation import durations_within_limits

_EXCESSES = (1.0, 1.2, 1.5, 2.0)  # of the limits, tried in turn
_LEAST_FACTOR, _MOST_FACTOR = 0.7, 4.0  # of the first guess of the durations
# What the first segment gets of its guess, tried in turn: where the present motion leads
# decides how long it must take, and the others need not be stretched alike.
_FIRST_SHARES = (1.0, 0.7, 1.4, 0.5, 2.0)
_SLOW = 1.0  # m/s
_YAW_ACCELERATION = 2.5  # rad/s^2; drag torques do not turn a drone much faster
_PEAK = 84 / 5**1.5  # acceleration of a flight of unit length and time, rest to rest
_NEAR = 1e-3  # m, rad and their derivatives: less is no difference


def plan_leg(
    start: np.ndarray, waypoints: ArrayLike, *, max_speed: float, max_acceleration: float
) -> FlatTrajectory:
    """Returns the minimum-snap flight through waypoints to rest at the last.

    Waypoints that coincide with the one before, or with the start, are left
    out. If none is left and the start is at rest, the flight stays there.

    Args:
        start: value and derivatives of x, y, z (m) and yaw (rad) to start
            from, (>= 4, 4); of yaw, only its value and its rate count.
        waypoints: x, y, z and yaw, (m, 4); yaw turns the shorter way.
        max_speed, max_acceleration: (m/s), (m/s^2); exceeded only by a start
            that is too fast for it.

    Raises:
        TrajectoryOptimizationError: if there is no such flight.
    """
    knots = np.vstack([start[0], waypoints])
    knots[:, 3] = np.unwrap(knots[:, 3])
    knots = knots[[True, *(np.abs(np.diff(knots, axis=0)).max(axis=1) > _NEAR)]]
    if len(knots) == 1:
        if np.abs(start[1:4]).max() > _NEAR:
            raise TrajectoryOptimizationError("No leg leads from motion to rest on the spot.")
        return FlatTrajectory.resting(knots[0])
    # Of a turn that is broken off, the rate alone goes on: a long flight with its angular
    # acceleration and jerk would turn round and round.
    begin = np.array(start[:4], float)
    begin[2:, 3] = 0.0
    constraints = end_constraints(begin, np.zeros((4, 4)), (1, 2, 3))
    speed = np.linalg.norm(start[1, :3])
    guess = trapezoid_durations(knots[:, :3], speed, 0.8 * max_speed, 0.5 * max_acceleration)
    # A turn on the spot takes time, too, and so does braking.
    turns = np.sqrt(_PEAK * np.abs(np.diff(knots[:, 3])) / _YAW_ACCELERATION)
    if speed > _SLOW:
        turns[0] = 0.0  # it is under way, and must not brake for the rest of a turn
    guess = np.maximum(guess, turns / _LEAST_FACTOR)
    guess *= max(1.0, speed / max_acceleration / guess.sum())
    problem = MinSnapProblem(knots, constraints=constraints)
    limits = np.array([max_speed, max_acceleration], float)
    for excess in _EXCESSES:
        for share in _FIRST_SHARES if len(guess) > 1 else (1.0,):
            shared = np.concatenate([[share * guess[0]], guess[1:]])
            with contextlib.suppress(TrajectoryOptimizationError):
                durations = durations_within_limits(
                    problem,
                    shared,
                    excess * limits,
                    min_factor=_LEAST_FACTOR,
                    max_factor=_MOST_FACTOR,
                )
                if np.all(durations >= (1.0 - 1e-9) * turns):
                    return FlatTrajectory(solve_min_snap(knots, durations, constraints=constraints))
    raise TrajectoryOptimizationError("No leg from this start leads through the waypoints.")


def end_constraints(start: np.ndarray, goal: np.ndarray, orders: Iterable[int]) -> list:
    """Returns constraints that fix derivatives of some orders at both ends of a flight.

    Args: start, goal: value and derivatives of x, y, z (m) and yaw (rad), (n, 4).
    """
    return [
        DerivativeConstraint(i, order, side[order])
        for i, side in ((0, start), (-1, goal))
        for order in orders
    ]


def trapezoid_durations(
    points: np.ndarray, start_speed: float, cruise_speed: float, acceleration: float
) -> np.ndarray:
    """Returns the times between points on straight lines, to rest at the last.

    Args:
        points: (m, 3).
        start_speed, cruise_speed: (m/s).
        acceleration: to and from the cruise speed (m/s^2).

    Returns: (m - 1,) in s; at least 0.2 s each.
    """
    knots = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    total = max(knots[-1], 1e-3)
    s = np.linspace(0.0, total, 401)
    middle = (s[1:] + s[:-1]) / 2
    gained, lost = 2 * acceleration * middle, 2 * acceleration * (total - middle)
    speed = np.sqrt(np.minimum(start_speed**2 + gained, lost))
    speed = np.minimum(speed, max(cruise_speed, start_speed))
    times = np.concatenate([[0.0], np.cumsum(np.diff(s) / speed)])
    return np.maximum(np.diff(np.interp(knots, s, times)), 0.2)
