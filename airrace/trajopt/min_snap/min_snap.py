"""Minimum-snap trajectories: smooth piecewise polynomials through waypoints.

Mellinger and Kumar, "Minimum snap trajectory generation and control for quadrotors" (ICRA 2011),
in the free-derivative form of Richter, Bry and Roy, "Polynomial trajectory planning for aggressive
quadrotor flight in dense indoor environments" (ISRR 2013).
"""

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydrake.solvers import SolverInterface
from pydrake.trajectories import PiecewisePolynomial

from airrace.math.small_matrices import cholesky, solve_cholesky
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.flat_trajectory import piecewise_polynomial
from airrace.trajopt.hermite import unit_segment
from airrace.trajopt.min_snap.program import MinSnapProgram

MAX_DEGREE = 19  # beyond, monomials lose too many digits
# What overflows ends in an error that says what to do.
_QUIET = np.errstate(all="ignore")
_NOT_UNIQUE = (
    "The minimum-snap trajectory is not unique, or its segment durations are too unlike each "
    "other; add waypoints or DerivativeConstraints, or even out the durations."
)


class DerivativeConstraint(NamedTuple):
    """Fixes a derivative of the trajectory at a waypoint."""

    waypoint: int  #: index of the waypoint; -1 is the last of an open trajectory
    order: int  #: 1 = velocity, 2 = acceleration, ..
    value: np.ndarray  #: (d,), in the waypoints' units / s^order; a NaN leaves its dimension free


def solve_min_snap(
    waypoints: ArrayLike,
    durations: ArrayLike,
    *,
    solver: SolverInterface | None = None,
    **options: Any,
) -> PiecewisePolynomial:
    """Returns the smoothest piecewise polynomial through the waypoints.

    It minimises the integral of the squared norm of a derivative, snap by default, for given
    segment durations: it builds MinSnapProblem.program() and solves it.

    Args:
        waypoints, options: see MinSnapProblem.
        durations: of the segments (s): one fewer than waypoints, or as many if periodic.
        solver: see MinSnapProgram.solve().

    Returns: a PiecewisePolynomial with d rows from time 0 to sum(durations).

    Raises:
        ValueError: if the input is malformed.
        TrajectoryOptimizationError: if the minimum is not unique.
    """
    problem = MinSnapProblem(waypoints, **options)
    problem.require_unique()
    return problem.program(durations).solve(solver)


class MinSnapProblem:
    """A minimum-snap problem in free-derivative form, whatever the durations.

    The variables x are the derivatives 0 ... n - 1 at the m waypoints, so that continuity is
    built in. Some are fixed; the others minimise x' H x / 2 + g' x, hence H x + g = 0 in
    their rows (Richter, Bry and Roy, equation 31). Derivative k of waypoint i is row i n + k
    of arrays with N = m n rows. The dimensions do not interact.

    Attributes:
        values: of fixed derivatives, positions from the origin; zero for the others, (N, d).
        fixed: which ones those are, (N, d).
        origin: the first waypoint, (d,).
        offset: what a lap adds to the first waypoint, (d,).
        rows: the rows of the ends of every segment, (segments, 2n).
        order: their derivative orders, (2n,).
    """

    def __init__(
        self,
        waypoints: ArrayLike,
        *,
        constraints: Sequence[DerivativeConstraint] = (),
        periodic: bool = False,
        period_offset: np.ndarray | None = None,
        degree: int = 9,
        minimized_derivative: int = 4,
    ):
        """Checks and arranges a problem.

        Args:
            waypoints: (m, d), m >= 2, as a rule metres, and radians for yaw, which must
                come unwrapped.
            constraints: DerivativeConstraints.
            periodic: whether one more segment leads back to the first waypoint,
                with all derivatives continuous around the loop.
            period_offset: (d,), what a lap adds to the first waypoint, e.g. 2 pi
                in yaw; zero by default.
            degree: of the polynomials, odd. Degree 2n - 1 makes the trajectory
                continuous through derivative n - 1.
            minimized_derivative: 1 = velocity, ..., 4 = snap; at most n.

        Raises:
            ValueError: if the input is malformed.
        """
        waypoints = np.array(waypoints, float)
        _require(
            waypoints.ndim == 2 and len(waypoints) >= 2 and np.all(np.isfinite(waypoints)),
            f"Waypoints must be finite and of shape (m >= 2, d), not {waypoints.shape}.",
        )
        _require(
            degree in range(1, MAX_DEGREE + 1, 2),
            f"The degree must be odd and at most {MAX_DEGREE}, not {degree}.",
        )
        (m, d), n = waypoints.shape, (degree + 1) // 2
        _require(
            minimized_derivative in range(1, n + 1),
            f"For degree {degree}, minimized_derivative must lie in 1 ... {n}, "
            f"not {minimized_derivative}.",
        )
        _require(periodic or period_offset is None, "A period_offset needs periodic=True.")
        offset = np.zeros(d) if period_offset is None else np.array(period_offset, float)
        _require(
            offset.shape == (d,) and np.all(np.isfinite(offset)),
            f"The period_offset must be {d} finite numbers, not {offset}.",
        )
        path = np.vstack([waypoints, waypoints[:1] + offset]) if periodic else waypoints
        for i in np.flatnonzero(np.all(np.abs(np.diff(path, axis=0)) < 1e-9, axis=1)):
            raise ValueError(f"Waypoints {i} and {(i + 1) % m} coincide; remove one of them.")
        values = np.full((m, n, d), np.nan)
        values[:, 0] = waypoints - waypoints[0]
        for constraint in constraints:
            _apply(constraint, values, periodic)
        values = values.reshape(m * n, d)
        start = np.arange(len(path) - 1)
        self.fixed = ~np.isnan(values)
        self.values = np.where(self.fixed, values, 0.0)
        self.origin, self.offset = waypoints[0], offset
        self.rows = np.hstack([i[:, None] * n + np.arange(n) for i in (start, (start + 1) % m)])
        self.order = np.tile(np.arange(n), 2)
        self.basis, self._unit_hessian = unit_segment(degree, minimized_derivative)
        # Of the duration, in a segment's Hessian.
        self._powers = 1.0 - 2 * minimized_derivative + self.order[:, None] + self.order

    def by_waypoint(self) -> np.ndarray:
        """Returns the fixed values, the others zero, (m, n, d)."""
        return self.values.reshape(-1, len(self.order) // 2, self.values.shape[1])

    @property
    def keeps_shape(self) -> bool:
        """Whether no derivative of x, y, z is fixed but at zero.

        Then time stretched by s divides speeds by s and accelerations by s^2.
        """
        return not self.by_waypoint()[:, 1:, :3].any()

    def check_durations(self, durations: ArrayLike) -> np.ndarray:
        """Returns them as an array; raises ValueError."""
        durations = np.array(durations, float)
        _require(
            durations.shape == (len(self.rows),),
            f"Durations must be {len(self.rows)}, one a segment, not {durations.shape}.",
        )
        valid = np.all(np.isfinite(durations) & (durations > 0))
        _require(valid, "Durations must be positive and finite.")
        return durations

    def program(self, durations: ArrayLike) -> MinSnapProgram:
        """Returns the program for given durations, to be added to and solved; see there.

        Raises:
            ValueError: if the durations are malformed.
        """
        return MinSnapProgram(self, self.check_durations(durations))

    def assemble(self, durations: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns the cost for given durations.

        That is its Hessian in each segment's end derivatives, (segments, 2n, 2n), and in all
        derivatives, (N, N), and its gradient, which the period offset adds, (N, d).
        """
        segments = self._unit_hessian * durations[:, None, None] ** self._powers
        hessian = np.zeros((len(self.values),) * 2)
        np.add.at(hessian, (self.rows[:, :, None], self.rows[:, None, :]), segments)
        gradient = np.zeros_like(self.values)
        gradient[self.rows[-1]] = np.outer(segments[-1, :, len(self.order) // 2], self.offset)
        return segments, hessian, gradient

    def require_unique(self, durations: np.ndarray | None = None) -> None:
        """Raises TrajectoryOptimizationError if there are many minima: a solver returns any.

        Args: durations: (segments,) s; by default all the same.
        """
        _, hessian, _ = self.assemble(np.ones(len(self.rows)) if durations is None else durations)
        for part, _ in self._free:
            free = hessian[part]
            scale = 1.0 / np.sqrt(np.diag(free))
            if not np.linalg.eigvalsh(free * scale[:, None] * scale)[0] > 1e-13:
                raise TrajectoryOptimizationError(_NOT_UNIQUE)

    @functools.cached_property
    def _free(self) -> list:
        """Where free rows are in H, and in arrays like the values: a pair for each pattern."""
        patterns, which = np.unique(~self.fixed, axis=1, return_inverse=True)
        return [
            (np.ix_(free, free), np.ix_(free, which.ravel() == k))
            for k, free in enumerate(patterns.T)
            if free.any()
        ]

    @_QUIET
    def solve_closed_form(self, durations: np.ndarray) -> np.ndarray:
        """Returns the derivatives at the waypoints that minimise the cost, (N, d).

        It is the fast path of program(), for searches that solve a thousand times.

        Raises:
            TrajectoryOptimizationError: if the equations cannot be solved.
        """
        _, hessian, gradient = self.assemble(durations)
        return self.values + self._solve_free(hessian, -(gradient + hessian @ self.values))

    @_QUIET
    def jacobian(self, durations: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Returns how the x of solve_closed_form() changes with the durations, (N, d, segments).

        H x + g = 0, hence dx = -H^-1 (dH x + dg).
        """
        segments, hessian, _ = self.assemble(durations)
        change = np.zeros((*x.shape, len(durations)))
        each = np.arange(len(durations))[:, None]
        by_T = segments * self._powers / durations[:, None, None]
        change[self.rows, :, each] = -by_T @ self.ends(x)
        return self._solve_free(hessian, change)

    def _solve_free(self, hessian: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Returns y, like right, with H y = right in free rows and y = 0 in fixed ones.

        Variables are scaled to unit curvature: derivatives of unlike orders have unlike units.
        """
        y = np.zeros_like(right)
        scale = 1.0 / np.sqrt(np.diag(hessian))[:, None]
        for part, place in self._free:
            s, b = scale[place[0][:, 0]], right[place]
            L = cholesky(s * hessian[part] * s.T)  # of NaN if the minimum is not unique
            columns = np.ascontiguousarray((s * b.reshape(len(s), -1)).T)
            solved = np.array([solve_cholesky(L, column) for column in columns]).T
            y[place] = (s * solved).reshape(b.shape)
        if not np.isfinite(y).all():
            raise TrajectoryOptimizationError(_NOT_UNIQUE)
        return y

    def ends(self, derivatives: np.ndarray) -> np.ndarray:
        """Returns the end derivatives of the segments, (segments, 2n, d)."""
        ends = derivatives[self.rows]
        ends[-1, len(self.order) // 2] += self.offset
        return ends

    def coefficients(self, durations: np.ndarray, derivatives: np.ndarray) -> np.ndarray:
        """Returns those of powers of t / duration, from the origin, (segments, 2n, d)."""
        powers = durations[:, None, None] ** self.order[:, None]
        return self.basis @ (powers * self.ends(derivatives))

    def trajectory(self, durations: np.ndarray, derivatives: np.ndarray) -> PiecewisePolynomial:
        """Returns the trajectory with these derivatives, (N, d)."""
        coefficients = self.coefficients(durations, derivatives)
        coefficients /= durations[:, None, None] ** np.arange(len(self.order))[:, None]
        coefficients[:, 0] += self.origin
        breaks = np.concatenate([[0.0], np.cumsum(durations)])
        return piecewise_polynomial(coefficients.swapaxes(1, 2), breaks)


def _apply(constraint: DerivativeConstraint, values: np.ndarray, periodic: bool) -> None:
    """Puts a constraint into values of derivatives, (m, n, d), those that are free NaN."""
    m, n, d = values.shape
    i, k, value = constraint.waypoint, constraint.order, np.array(constraint.value, float)
    first = 0 if periodic else -1
    _require(i in range(first, m), f"Waypoint {i} of a constraint is not in {first} ... {m - 1}.")
    _require(
        k in range(1, n),
        f"A constraint's order must lie in 1 ... {n - 1}, not {k}; "
        f"raise the degree, now {2 * n - 1}, for higher ones.",
    )
    if value.shape != (d,) or np.isinf(value).any():  # printing an array takes its time
        raise ValueError(f"A constraint's value must be {d} numbers or NaNs, not {value}.")
    _require(
        not np.any(np.abs(value - values[i, k]) > 1e-6 * (1 + np.abs(value))),
        f"Two constraints fix derivative {k} at waypoint {i} differently.",
    )
    values[i, k] = np.where(np.isnan(value), values[i, k], value)


def _require(condition, message):
    if not condition:
        raise ValueError(message)
