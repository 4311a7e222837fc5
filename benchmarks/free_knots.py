"""How far knots that may move bring the minimum-snap lap down.

Between two gates there is one knot more or several, and where they lie is optimised with
the durations. At a given place and time, a knot changes nothing: what is the smoothest
without it is so with it.
"""

import numpy as np
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.solvers import MathematicalProgram, SnoptSolver

from airrace.trajopt.min_snap.limit_samples import LimitSamples
from airrace.trajopt.min_snap.min_snap import solve_min_snap
from airrace.trajopt.min_snap.problem import MinSnapProblem
from airrace.trajopt.min_snap.time_allocation import (
    allocate_times,
    durations_within_limits,
    peak_speed_and_acceleration,
)

_SAMPLES = 16  # of a segment
_REACH = 8.0  # m, that a knot may be off the lap without it
_BOUNDS = (1.0, 0.99)  # on samples: limits may be exceeded between them


def free_knot_lap(midpoints, *, knots: int, max_speed: float, max_acceleration: float):
    """Returns the lap time of three dimensions with free knots in each leg, and without (s).

    Args:
        midpoints: of the gates, (n, 3) m.
        knots: in each leg.
        max_speed, max_acceleration: (m/s), (m/s^2).
    """
    limits = dict(max_speed=max_speed, max_acceleration=max_acceleration)
    durations = allocate_times(midpoints, periodic=True, **limits)
    lap = solve_min_snap(midpoints, durations, periodic=True)
    fractions = np.arange(knots + 1) / (knots + 1)
    breaks = np.concatenate([[0.0], np.cumsum(durations)])
    times = (breaks[:-1, None] + durations[:, None] * fractions).ravel()
    points = lap.vector_values(times).T
    free = np.flatnonzero(np.arange(len(points)) % (knots + 1))
    found = [durations.sum()]
    for bound in _BOUNDS:
        T, P = _search(
            points,
            np.repeat(durations / (knots + 1), knots + 1),
            free,
            np.array([max_speed, max_acceleration]),
            bound,
        )
        T = durations_within_limits(P, T, periodic=True, **limits)
        speed, acceleration = peak_speed_and_acceleration(solve_min_snap(P, T, periodic=True))
        assert speed <= max_speed * (1 + 1e-6) and acceleration <= max_acceleration * (1 + 1e-6)
        found.append(T.sum())
    return float(min(found)), float(durations.sum())


def _search(points, durations, free, limits, bound):
    """Returns durations (s) and points (m) of a local minimum, or where the solver got stuck."""
    segments, count = len(durations), len(free)

    def placed(x):
        moved = points.copy()
        moved[free] = x[segments:].reshape(count, 3)
        return MinSnapProblem.build(moved, periodic=True)

    def values(x):
        return LimitSamples(placed(x), limits, _SAMPLES)(x[:segments])

    def constraint(x):
        if x.dtype != object:
            return values(x)[0]
        at = ExtractValue(x).ravel()
        value, by_T = values(at)
        jacobian = np.hstack([by_T, _by_points(placed(at), at[:segments], free, limits)])
        return InitializeAutoDiff(value, jacobian @ ExtractGradient(x)).ravel()

    program = MathematicalProgram()
    x = program.NewContinuousVariables(segments + 3 * count)
    program.AddLinearCost(np.ones(segments), x[:segments])
    program.AddBoundingBoxConstraint(0.3 * durations, 3.0 * durations, x[:segments])
    places = points[free].ravel()
    program.AddBoundingBoxConstraint(places - _REACH, places + _REACH, x[segments:])
    start = np.concatenate([durations, places])
    size = len(values(start)[0])
    program.AddConstraint(constraint, np.full(size, -np.inf), np.full(size, bound), x)
    found = SnoptSolver().Solve(program, start).GetSolution(x)
    moved = points.copy()
    moved[free] = found[segments:].reshape(count, 3)
    return found[:segments], moved


def _by_points(problem, durations, free, limits):
    """Returns the Jacobian of LimitSamples by the places of free waypoints, (rows, 3 count)."""
    samples = LimitSamples(problem, limits, _SAMPLES)
    ends = samples.ends(durations)
    _, hessian, _ = problem.assemble(durations)
    n = len(problem.order) // 2
    fixed = np.arange(len(hessian)) % n == 0
    response = np.zeros((len(hessian), len(free)))
    response[free * n, np.arange(len(free))] = 1.0
    scale = 1.0 / np.sqrt(np.diag(hessian)[~fixed])
    inner = hessian[np.ix_(~fixed, ~fixed)] * scale[:, None] * scale
    response[~fixed] = -scale[:, None] * np.linalg.solve(
        inner, scale[:, None] * hessian[np.ix_(~fixed, free * n)]
    )
    unit = response[problem.rows]  # (segments, 2n, count)
    T = durations[:, None, None]
    blocks = []
    for k, rows in zip((1, 2), samples.maps):
        rows = rows * T ** (problem.order - k)
        x, dx = rows @ ends, rows @ unit
        block = 2.0 * x[:, :, None, :] * dx[..., None]  # (segments, samples, count, 3)
        blocks.append(block.reshape(-1, 3 * len(free)))
    return np.vstack(blocks)
