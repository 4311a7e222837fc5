"""By how much a minimum-snap trajectory exceeds limits; searches ask thousands of times."""

import math

import numpy as np

from airrace.common.jit import all_finite, compilable, compiled
from airrace.math.small_matrices import cholesky, solve_cholesky
from airrace.trajopt.min_snap.min_snap import TrajectoryOptimizationError, is_singular
from airrace.trajopt.min_snap.problem import MinSnapProblem, unit_segment

_SAMPLES = 50  # of a segment, which bracket the peaks
_GRID, _ROUNDS = 17, 4  # that refine them
_NEAR = 0.95  # of the greatest sample: lesser peaks are not refined


class LimitExcess:
    """How many times slower the trajectory of a problem must be to keep to limits.

    It is that of solve_min_snap(), from the same equations: the free derivatives x at
    the waypoints satisfy H x + g = 0 (Richter, Bry and Roy, "Polynomial trajectory
    planning for aggressive quadrotor flight in dense indoor environments", eq. 31).
    Here they are solved by Cholesky's factors, in machine code.

    Attributes:
        problem: see below.
    """

    def __init__(self, problem: MinSnapProblem):
        """Constructs the function.

        Args:
            problem: x, y and z first.

        Raises:
            TrajectoryOptimizationError: if the minimum is not unique.
        """
        basis, unit_hessian = unit_segment(problem.degree, problem.minimized_derivative)
        count = min(problem.values.shape[1], 3)
        _check_unique(problem, count)
        self.problem = problem
        self._arguments = (
            problem.values[:, :count].T.copy(),
            problem.fixed[:, :count].T.copy(),
            problem.rows,
            problem.order,
            unit_hessian,
            basis,
            problem.offset[:count].copy(),
            1 - 2 * problem.minimized_derivative,
        )

    def __call__(self, durations, limits) -> float:
        """Returns the greatest of speed / limit and sqrt(acceleration / limit).

        Args:
            durations: of the segments (s).
            limits: of speed (m/s) and acceleration (m/s^2), (2,).

        Raises:
            ValueError: if the durations are malformed.
            TrajectoryOptimizationError: if the minimum is not unique.
        """
        durations = self.problem.check_durations(durations)
        excess = _excess(durations, *self._arguments, np.asarray(limits, float))
        if not math.isfinite(excess):
            raise TrajectoryOptimizationError(
                "The minimum-snap trajectory is not unique; even out the durations."
            )
        return excess


def _check_unique(problem, count):
    """Raises TrajectoryOptimizationError if not, whatever the durations, in a dimension < count."""
    _, hessian, _ = problem.assemble(np.ones(len(problem.rows)))
    for free in np.unique(~problem.fixed[:, :count], axis=1).T:
        part = hessian[np.ix_(free, free)]
        scale = 1.0 / np.sqrt(np.diag(part))
        if free.any() and is_singular(part * scale[:, None] * scale):
            raise TrajectoryOptimizationError(
                "The minimum-snap trajectory is not unique; add waypoints or DerivativeConstraints."
            )


@compiled
def _excess(durations, values, fixed, rows, order, unit_hessian, basis, offset, power, limits):
    """See LimitExcess; NaN if the equations cannot be solved.

    Args:
        durations: (segments,) s.
        values, fixed: of MinSnapProblem, but (d, N).
        rows, order, offset: of MinSnapProblem.
        unit_hessian, basis: see unit_segment().
        power: 1 - 2 minimized_derivative.
        limits: of speed and acceleration, (2,).
    """
    d, size = values.shape
    segments, hessian, scale = assembled(durations, size, rows, order, unit_hessian, power)
    solved = values.copy()
    for k in range(d):
        free, matrix, linear = equations(
            values[k], fixed[k], hessian, scale, segments[-1], rows[-1], offset[k]
        )
        solved[k][free] = scale[free] * solve_cholesky(cholesky(matrix), linear)
        if not all_finite(solved[k]):
            return math.nan
    coefficients = _normalized(durations, solved, rows, order, basis, offset)
    speed = _peak(coefficients, durations, 1)
    return max(speed / limits[0], math.sqrt(_peak(coefficients, durations, 2) / limits[1]))


@compilable
def assembled(durations, size, rows, order, unit_hessian, power):
    """Returns what MinSnapProblem.assemble() does, for compiled functions.

    Args:
        size: number of derivatives at waypoints, N.
        others: see LimitExcess.

    Returns:
        segments, (segments, 2n, 2n), and hessian, (N, N), of the cost, and scale, (N,), of
        the variables for unit curvature.
    """
    count, width = rows.shape
    segments = np.empty((count, width, width))
    hessian = np.zeros((size, size))
    for s in range(count):
        powers = durations[s] ** (power + np.arange(0.0, width - 1))
        for i in range(width):
            for j in range(width):
                segments[s, i, j] = unit_hessian[i, j] * powers[order[i] + order[j]]
                hessian[rows[s, i], rows[s, j]] += segments[s, i, j]
    scale = np.empty(size)
    for i in range(size):
        scale[i] = 1.0 / math.sqrt(hessian[i, i])
    return segments, hessian, scale


@compilable
def equations(values, fixed, hessian, scale, last_segment, last_rows, offset):
    """Returns free, matrix and linear: derivatives values[free] = scale[free] matrix^-1 linear.

    Args:
        values, fixed: of one dimension of a MinSnapProblem, (N,).
        hessian, scale, last_segment: see assembled().
        last_rows: of the last segment in values.
        offset: of one dimension of the period.
    """
    free = np.flatnonzero(~fixed)
    n, half = len(free), len(last_rows) // 2
    matrix, linear = np.empty((n, n)), np.zeros(n)
    for a in range(n):
        i = free[a]
        for j in range(len(values)):
            if fixed[j]:
                linear[a] -= hessian[i, j] * values[j]
        for b in range(len(last_rows)):
            if last_rows[b] == i:
                linear[a] -= last_segment[b, half] * offset
        linear[a] *= scale[i]
        for b in range(n):
            matrix[a, b] = scale[i] * hessian[i, free[b]] * scale[free[b]]
    return free, matrix, linear


@compilable
def _normalized(durations, solved, rows, order, basis, offset):
    """Returns coefficients of powers of t / duration, (segments, d, 2n)."""
    d, (count, width) = len(solved), rows.shape
    result = np.zeros((count, d, width))
    for s in range(count):
        for k in range(d):
            for j in range(width):
                end = solved[k, rows[s, j]]
                if s == count - 1 and j == width // 2:
                    end += offset[k]
                end *= durations[s] ** order[j]
                for i in range(width):
                    result[s, k, i] += basis[i, j] * end
    return result


@compilable
def _norm(coefficients, duration, derivative, t):
    """Returns the norm of a derivative, 1 or 2, at a fraction t of a segment."""
    d, width = coefficients.shape
    square = 0.0
    for k in range(d):
        value = 0.0
        for i in range(width - 1, derivative - 1, -1):
            factor = i if derivative == 1 else i * (i - 1)
            value = value * t + factor * coefficients[k, i]
        square += value * value
    return math.sqrt(square) / duration**derivative


@compilable
def _peak(coefficients, durations, derivative):
    """Returns the greatest norm of a derivative, to about nine digits."""
    count = len(durations)
    norms = np.empty((count, _SAMPLES + 1))
    for s in range(count):
        for i in range(_SAMPLES + 1):
            norms[s, i] = _norm(coefficients[s], durations[s], derivative, i / _SAMPLES)
    most = norms.max()
    result = most
    for s in range(count):
        for i in range(_SAMPLES + 1):
            here = norms[s, i]
            # A peak, as far as this segment knows.
            if not (
                here >= _NEAR * most
                and (i == 0 or here >= norms[s, i - 1])
                and (i == _SAMPLES or here >= norms[s, i + 1])
            ):
                continue
            low, high = max(i - 1, 0) / _SAMPLES, min(i + 1, _SAMPLES) / _SAMPLES
            for _ in range(_ROUNDS):
                step, best, at = (high - low) / (_GRID - 1), -1.0, 0
                for k in range(_GRID):
                    value = _norm(coefficients[s], durations[s], derivative, low + k * step)
                    if value > best:
                        best, at = value, k
                low, high = low + max(at - 1, 0) * step, low + min(at + 1, _GRID - 1) * step
                result = max(result, best)
    return result
