"""Minimum-snap trajectories: smooth piecewise polynomials through waypoints."""

import dataclasses as dc

import numpy as np
from pydrake.solvers import MathematicalProgram, Solve
from pydrake.trajectories import PiecewisePolynomial

from airrace.trajopt.min_snap.problem import MinSnapProblem


class TrajectoryOptimizationError(ValueError):
    """There is no such trajectory, or the solver found none."""


@dc.dataclass(frozen=True, eq=False)
class DerivativeConstraint:
    """Fixes a derivative of the trajectory at a waypoint.

    Attributes:
        waypoint: index of the waypoint; -1 is the last of an open trajectory.
        order: 1 = velocity, 2 = acceleration, ...
        value: (d,), in the waypoints' units / s^order; a NaN leaves its
            dimension free.
    """

    waypoint: int
    order: int
    value: np.ndarray

    def __post_init__(self):
        object.__setattr__(self, "value", np.atleast_1d(np.array(self.value, float)))


def unwrap_headings(headings) -> np.ndarray:
    """Returns headings (rad), (m,), such that no step exceeds half a turn."""
    return np.unwrap(np.asarray(headings, float))


def turn_per_lap(headings) -> float:
    """Returns by how much yaw grows (rad) in a lap of headings (rad), (m,).

    It is a multiple of 2 pi: the yaw entry of the lap's ``period_offset``.
    """
    closed = unwrap_headings(np.append(headings, headings[0]))
    return float(2 * np.pi * np.round((closed[-1] - closed[0]) / (2 * np.pi)))


def solve_min_snap(
    waypoints,
    durations,
    *,
    constraints=(),
    periodic=False,
    period_offset=None,
    degree=9,
    minimized_derivative=4,
) -> PiecewisePolynomial:
    """Returns the smoothest piecewise polynomial through the waypoints.

    It minimises the integral of the squared norm of a derivative, snap by
    default (Mellinger and Kumar, ICRA 2011), for given segment durations. The
    quadratic program has the free-derivative form of Richter, Bry and Roy,
    "Polynomial trajectory planning for aggressive quadrotor flight in dense
    indoor environments": the variables are the derivatives at the waypoints
    that nobody fixed, so continuity is built in and no constraint is left.
    Each segment has normalised time and each variable unit curvature; raw
    coefficients of degree 9 are conditioned at 1e10.

    The dimensions do not interact, hence need no weights. Yaw must come
    unwrapped, see unwrap_headings().

    Args:
        waypoints: (m, d), m >= 2, as a rule metres, and radians for yaw.
        durations: of the segments (s): m - 1 of them, or m if periodic.
        constraints: DerivativeConstraints.
        periodic: whether one more segment leads back to the first waypoint,
            with all derivatives continuous around the loop.
        period_offset: (d,), what a lap adds to the first waypoint, e.g. 2 pi
            in yaw; zero by default.
        degree: of the polynomials, odd. Degree 2n - 1 makes the trajectory
            continuous through derivative n - 1.
        minimized_derivative: 1 = velocity, ..., 4 = snap; at most n.

    Returns:
        a PiecewisePolynomial with d rows from time 0 to sum(durations).

    Raises:
        ValueError: if the input is malformed.
        TrajectoryOptimizationError: if the minimum is not unique.
    """
    problem = MinSnapProblem.build(
        waypoints,
        constraints=constraints,
        periodic=periodic,
        period_offset=period_offset,
        degree=degree,
        minimized_derivative=minimized_derivative,
    )
    durations = problem.check_durations(durations)
    _, hessian, gradient = problem.assemble(durations)
    scale = 1.0 / np.sqrt(np.diag(hessian))
    hessian = hessian * scale[:, None] * scale
    derivatives = problem.values.copy()
    for j, fixed in enumerate(problem.fixed.T):
        if not fixed.all():
            free = ~fixed
            linear = hessian[np.ix_(free, fixed)] @ (problem.values[fixed, j] / scale[fixed])
            linear += gradient[free, j] * scale[free]
            derivatives[free, j] = scale[free] * _minimize(hessian[np.ix_(free, free)], linear)
    return problem.trajectory(durations, derivatives)


def _minimize(hessian, linear):
    """Returns the x that minimises x' hessian x / 2 + linear' x."""
    size = max(np.abs(linear).max(), 1e-300)  # makes the tolerances relative
    program = MathematicalProgram()
    x = program.NewContinuousVariables(len(linear), "x")
    program.AddQuadraticCost(hessian, linear / size, x, is_convex=True)
    result = Solve(program)
    solution = result.GetSolution(x)
    residual = np.abs(hessian @ solution + linear / size).max()
    exact = result.is_success() and residual <= 1e-9 * (1 + np.abs(solution).max())
    if is_singular(hessian) or not exact:
        raise TrajectoryOptimizationError(
            "The minimum-snap trajectory is not unique, or its segment durations are too unlike "
            "each other; add waypoints or DerivativeConstraints, or even out the durations."
        )
    return size * solution


def is_singular(hessian) -> bool:
    """Whether a Hessian of unit diagonal, (n, n), has many minima: a solver returns any."""
    return not np.linalg.eigvalsh(hessian)[0] > 1e-13
