"""Minimum-snap trajectories: smooth piecewise polynomials through waypoints."""

import dataclasses as dc
import functools
from fractions import Fraction
from math import comb, factorial, perm

import numpy as np
from pydrake.polynomial import Polynomial
from pydrake.solvers import MathematicalProgram, Solve
from pydrake.trajectories import PiecewisePolynomial

MAX_DEGREE = 19  # beyond, monomials lose too many digits


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


def solve_min_snap(waypoints, durations, *, constraints=(), periodic=False, period_offset=None,
                   degree=9, minimized_derivative=4) -> PiecewisePolynomial:
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
        waypoints, constraints=constraints, periodic=periodic, period_offset=period_offset,
        degree=degree, minimized_derivative=minimized_derivative)
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
            "each other; add waypoints or DerivativeConstraints, or even out the durations.")
    return size * solution


def is_singular(hessian) -> bool:
    """Whether a Hessian of unit diagonal, (n, n), has many minima: a solver returns any."""
    return not np.linalg.eigvalsh(hessian)[0] > 1e-13


@dc.dataclass(frozen=True, eq=False)
class MinSnapProblem:
    """A checked problem in free-derivative form, shared with time allocation.

    Derivative k of waypoint i is row i n + k of arrays with N = m n rows.
    """

    values: np.ndarray  # (N, d), of fixed derivatives, positions from the origin; or zero
    fixed: np.ndarray  # (N, d), which ones those are
    origin: np.ndarray  # (d,), the first waypoint
    offset: np.ndarray  # (d,), see period_offset of solve_min_snap()
    rows: np.ndarray  # (segments, 2n), the rows of the ends of every segment
    order: np.ndarray  # (2n,), their derivative orders
    degree: int
    minimized_derivative: int

    @classmethod
    def build(cls, waypoints, *, constraints=(), periodic=False, period_offset=None, degree=9,
              minimized_derivative=4):
        """Checks the arguments of solve_min_snap(); raises ValueError."""
        waypoints = np.array(waypoints, float)
        _require(waypoints.ndim == 2 and len(waypoints) >= 2 and np.all(np.isfinite(waypoints)),
                 f"waypoints must be finite and of shape (m >= 2, d), not {waypoints.shape}")
        _require(degree in range(1, MAX_DEGREE + 1, 2),
                 f"degree must be odd and at most {MAX_DEGREE}, not {degree}")
        (m, d), n = waypoints.shape, (degree + 1) // 2
        _require(minimized_derivative in range(1, n + 1), "minimized_derivative must lie in "
                 f"1 ... {n} for degree {degree}, not {minimized_derivative}")
        _require(periodic or period_offset is None, "period_offset needs periodic=True")
        offset = np.zeros(d) if period_offset is None else np.array(period_offset, float)
        _require(offset.shape == (d,) and np.all(np.isfinite(offset)),
                 f"period_offset must be {d} finite numbers, not {offset}")
        path = np.vstack([waypoints, waypoints[:1] + offset]) if periodic else waypoints
        for i in np.flatnonzero(np.all(np.abs(np.diff(path, axis=0)) < 1e-9, axis=1)):
            _require(False, f"waypoints {i} and {(i + 1) % m} coincide; remove one of them")
        values = np.full((m, n, d), np.nan)
        values[:, 0] = waypoints - waypoints[0]
        for constraint in constraints:
            _apply(constraint, values, periodic)
        values = values.reshape(m * n, d)
        fixed = ~np.isnan(values)
        start = np.arange(len(path) - 1)
        rows = np.hstack([i[:, None] * n + np.arange(n) for i in (start, (start + 1) % m)])
        return cls(np.where(fixed, values, 0.0), fixed, waypoints[0], offset, rows,
                   np.tile(np.arange(n), 2), degree, minimized_derivative)

    def check_durations(self, durations) -> np.ndarray:
        """Returns them as an array; raises ValueError."""
        durations = np.array(durations, float)
        _require(durations.shape == (len(self.rows),),
                 f"durations must be {len(self.rows)}, one a segment, not {durations.shape}")
        _require(np.all(np.isfinite(durations) & (durations > 0)),
                 "durations must be positive and finite")
        return durations

    def assemble(self, durations):
        """Returns the cost: its Hessian in each segment's end derivatives,
        (segments, 2n, 2n), in all derivatives, (N, N), and the gradient that
        the period offset adds, (N, d)."""
        power = 1 - 2 * self.minimized_derivative + self.order[:, None] + self.order
        _, unit_hessian = unit_segment(self.degree, self.minimized_derivative)
        segments = unit_hessian * durations[:, None, None] ** power
        hessian = np.zeros((len(self.values),) * 2)
        np.add.at(hessian, (self.rows[:, :, None], self.rows[:, None, :]), segments)
        gradient = np.zeros_like(self.values)
        gradient[self.rows[-1]] = np.outer(segments[-1, :, len(self.order) // 2], self.offset)
        return segments, hessian, gradient

    def ends(self, derivatives) -> np.ndarray:
        """Returns the end derivatives of the segments, (segments, 2n, d)."""
        ends = derivatives[self.rows]
        ends[-1, len(self.order) // 2] += self.offset
        return ends

    def trajectory(self, durations, derivatives) -> PiecewisePolynomial:
        """Returns the trajectory with these derivatives, (N, d)."""
        basis, _ = unit_segment(self.degree, self.minimized_derivative)
        T = durations[:, None, None]
        coefficients = basis @ (T ** self.order[:, None] * self.ends(derivatives))
        coefficients /= T ** np.arange(self.degree + 1)[:, None]
        coefficients[:, 0] += self.origin
        return PiecewisePolynomial(
            [np.array([[Polynomial(c)] for c in segment.T]) for segment in coefficients],
            np.concatenate([[0.0], np.cumsum(durations)]))


@functools.cache
def unit_segment(degree: int, minimized_derivative: int):
    """Returns what end derivatives make of a segment of unit duration.

    The Hermite interpolant of n derivatives x_k at 0 and y_k at 1 is
    sum_k x_k b_k(t) + y_k (-1)^k b_k(1 - t), where
    b_k(t) = t^k / k! (1 - t)^n sum_{s < n - k} C(n + s - 1, s) t^s.

    Returns:
        (basis, hessian), each (2n, 2n), from (x_0 ..., y_0 ...): to monomial
        coefficients, and of the squared derivative's integral.
    """
    n, r = (degree + 1) // 2, minimized_derivative
    t, u = (np.polynomial.Polynomial(c) for c in ([0.0, 1.0], [1.0, -1.0]))
    # In rational numbers: rounding would cost the Hessian its null space.
    basis = np.array([
        [Fraction(int(c), factorial(k)) for c in (
            a**k * b**n * sum(comb(n + s - 1, s) * c**s for s in range(n - k))).coef]
        for a, b, c in ((t, u, t), (-u, t, u)) for k in range(n)]).T
    cost = np.array([[Fraction(perm(i, r) * perm(j, r), max(i + j - 2 * r, 0) + 1)
                      for j in range(2 * n)] for i in range(2 * n)])
    return basis.astype(float), (basis.T @ cost @ basis).astype(float)


def _apply(constraint, values, periodic):
    m, n, d = values.shape
    i, k, value = constraint.waypoint, constraint.order, constraint.value
    first = 0 if periodic else -1
    _require(i in range(first, m), f"waypoint {i} of a constraint is not in {first} ... {m - 1}")
    _require(k in range(1, n), f"a constraint's order must lie in 1 ... {n - 1}, not {k}; "
             f"raise the degree, now {2 * n - 1}, for higher ones")
    if value.shape != (d,) or np.isinf(value).any():  # printing an array takes its time
        raise ValueError(f"A constraint's value must be {d} numbers or NaNs, not {value}.")
    _require(not np.any(np.abs(value - values[i, k]) > 1e-6 * (1 + np.abs(value))),
             f"two constraints fix derivative {k} at waypoint {i} differently")
    values[i, k] = np.where(np.isnan(value), values[i, k], value)


def _require(condition, message):
    if not condition:
        raise ValueError(f"{message[0].upper()}{message[1:]}.")
