"""How near minimum-snap trajectories come to limits of speed and acceleration.

Searches ask thousands of times, so the trajectory is solved for in compiled code.
"""

import math
from math import perm
from typing import NamedTuple

import numpy as np

from airrace.common.jit import all_finite, compilable, compiled
from airrace.math.small_matrices import cholesky, solve_cholesky
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.flat_trajectory import segment_coefficients
from airrace.trajopt.min_snap.min_snap import NOT_UNIQUE, MinSnapProblem, unit_segment

_SAMPLES = 50  # of a segment, which bracket the peaks
_REFINED, _ROUNDS = 17, 4  # samples about a peak, and how often they are drawn closer
_NEAR = 0.95  # of the greatest sample: lesser peaks are not refined


class _Equations(NamedTuple):
    """A MinSnapProblem of d dimensions, as compiled functions take it.

    Attributes:
        values, fixed: see there, (d, N).
        rows, order: see there.
        offset: see there, (d,).
        basis, unit_hessian: see unit_segment().
        power: of a duration in the cost, without that of the derivatives.
    """

    values: np.ndarray
    fixed: np.ndarray
    rows: np.ndarray
    order: np.ndarray
    offset: np.ndarray
    basis: np.ndarray
    unit_hessian: np.ndarray
    power: int

    @classmethod
    def of(cls, problem: MinSnapProblem) -> "_Equations":
        """Returns those of x, y and z."""
        return cls(
            problem.values[:, :3].T.copy(),
            problem.fixed[:, :3].T.copy(),
            problem.rows,
            problem.order,
            problem.offset[:3].copy(),
            *unit_segment(problem.degree, problem.minimized_derivative),
            1 - 2 * problem.minimized_derivative,
        )


def slowdown_factor(problem: MinSnapProblem, durations, limits) -> float:
    """Returns the greatest of speed / limit and sqrt(acceleration / limit) on a trajectory.

    That is how many times slower it must be flown along the same path.

    Args:
        problem: of x, y, z, and more or less.
        durations: of the segments (s).
        limits: of speed (m/s) and acceleration (m/s^2), (2,).

    Raises:
        ValueError: if the durations are malformed.
        TrajectoryOptimizationError: if the minimum is not unique.
    """
    durations = problem.check_durations(durations)
    factor = _slowdown_factor(_Equations.of(problem), durations, np.asarray(limits, float))
    if not math.isfinite(factor):
        raise TrajectoryOptimizationError(NOT_UNIQUE)
    return factor


def peak_speed_and_acceleration(trajectory) -> tuple[float, float]:
    """Returns the greatest speed (m/s) and acceleration (m/s^2) of a trajectory.

    Both are norms over x, y, z, without gravity, good to about nine digits.

    Args:
        trajectory: PiecewisePolynomial whose first three rows are x, y, z.
    """
    durations = np.diff(trajectory.get_segment_times())
    coefficients = segment_coefficients(trajectory)[:, :3]
    coefficients = coefficients * durations[:, None, None] ** np.arange(coefficients.shape[2])
    return tuple(_peak_norm(coefficients, durations, k) for k in (1, 2))


class LimitSamples:
    """|v|^2 / v_max^2 and |a|^2 / a_max^2 at samples, as functions of the durations."""

    def __init__(self, problem: MinSnapProblem, limits, samples: int):
        """Args: problem: see there. limits: of v and a. samples: a segment."""
        self._equations = _Equations.of(problem)
        fractions, powers = np.linspace(0, 1, samples), range(problem.degree + 1)
        # From derivatives at a segment's ends, times duration^order, to its samples of velocity
        # and acceleration, times duration and its square, as shares of the limits.
        self._maps = np.array(
            [
                np.array([[perm(j, k) * t ** max(j - k, 0) for j in powers] for t in fractions])
                @ self._equations.basis
                / limits[k - 1]
                for k in (1, 2)
            ]
        )

    def __call__(self, durations):
        """Returns the samples, (count,), and their Jacobian, (count, segments).

        Args:
            durations: of the segments (s).

        Returns:
            two arrays, with NaN if the durations are too unlike each other.
        """
        return _limit_samples(self._equations, np.array(durations, float), self._maps)


@compiled
def _slowdown_factor(equations, durations, limits):
    """See slowdown_factor(); NaN if the equations cannot be solved."""
    segments, hessian, scale = _assemble(equations, durations)
    derivatives = np.empty_like(equations.values)
    for k in range(len(derivatives)):
        free, factor, linear = _factorize(equations, k, segments, hessian, scale)
        derivatives[k] = equations.values[k]
        derivatives[k][free] = scale[free] * solve_cholesky(factor, linear)
        if not all_finite(derivatives[k]):
            return math.nan
    coefficients = _coefficients(equations, durations, derivatives)
    speed = _peak_norm(coefficients, durations, 1)
    return max(speed / limits[0], math.sqrt(_peak_norm(coefficients, durations, 2) / limits[1]))


@compilable
def _assemble(equations, durations):
    """Returns the cost's Hessian by segments and as a whole, and its scale for unit curvature.

    Shapes: (segments, 2n, 2n), (N, N), (N,).
    """
    rows, order = equations.rows, equations.order
    (count, width), size = rows.shape, equations.values.shape[1]
    segments, hessian = np.empty((count, width, width)), np.zeros((size, size))
    for s in range(count):
        powers = durations[s] ** (equations.power + np.arange(0.0, width - 1))
        for i in range(width):
            for j in range(width):
                segments[s, i, j] = equations.unit_hessian[i, j] * powers[order[i] + order[j]]
                hessian[rows[s, i], rows[s, j]] += segments[s, i, j]
    return segments, hessian, 1.0 / np.sqrt(np.diag(hessian))


@compilable
def _factorize(equations, k, segments, hessian, scale):
    """Returns (free, L, b): in dimension k, x[free] = scale[free] y with L L' y = b."""
    values, fixed, last = equations.values[k], equations.fixed[k], equations.rows[-1]
    free = np.flatnonzero(~fixed)
    linear = np.zeros(len(free))
    for a, i in enumerate(free):
        for j in np.flatnonzero(fixed):
            linear[a] -= hessian[i, j] * values[j]
        for b in np.flatnonzero(last == i):
            linear[a] -= segments[-1, b, len(last) // 2] * equations.offset[k]
    matrix = (scale.reshape(-1, 1) * hessian * scale)[free][:, free]
    return free, cholesky(np.ascontiguousarray(matrix)), linear * scale[free]


@compilable
def _coefficients(equations, durations, derivatives):
    """Returns coefficients of powers of t / duration, (segments, d, 2n)."""
    rows, order, basis = equations.rows, equations.order, equations.basis
    (count, width), d = rows.shape, len(derivatives)
    result = np.zeros((count, d, width))
    for s in range(count):
        for k in range(d):
            for j in range(width):
                end = derivatives[k, rows[s, j]]
                if s == count - 1 and j == width // 2:
                    end += equations.offset[k]
                result[s, k] += basis[:, j] * (end * durations[s] ** order[j])
    return result


@compiled
def _peak_norm(coefficients, durations, derivative):
    """Returns the greatest norm of a derivative of polynomials, to about nine digits.

    Args:
        coefficients: of powers of t / duration, (segments, d, k).
        durations: of the segments (s).
        derivative: 1 or 2.
    """
    fractions = np.arange(_SAMPLES + 1) / _SAMPLES
    norms = np.empty((len(durations), _SAMPLES + 1))
    for s in range(len(durations)):
        norms[s] = _norms(coefficients[s], durations[s], derivative, fractions)
    peak = norms.max()
    for s, i in zip(*np.nonzero(norms >= _NEAR * peak)):
        before, after = max(i - 1, 0), min(i + 1, _SAMPLES)
        if norms[s, i] < max(norms[s, before], norms[s, after]):
            continue
        low, high = fractions[before], fractions[after]
        for _ in range(_ROUNDS):
            finer = low + np.arange(_REFINED) * ((high - low) / (_REFINED - 1))
            refined = _norms(coefficients[s], durations[s], derivative, finer)
            best = refined.argmax()
            peak = max(peak, refined[best])
            low, high = finer[max(best - 1, 0)], finer[min(best + 1, _REFINED - 1)]
    return peak


@compilable
def _norms(coefficients, duration, derivative, fractions):
    """Returns norms of a derivative at fractions of a segment, (n,), by Horner's rule."""
    squares = np.zeros(len(fractions))
    for row in coefficients:
        values = np.zeros(len(fractions))
        for i in range(len(row) - 1, derivative - 1, -1):
            factor = i if derivative == 1 else i * (i - 1)
            values = values * fractions + factor * row[i]
        squares += values * values
    return np.sqrt(squares) / duration**derivative


@compiled
def _limit_samples(equations, durations, maps):
    """See LimitSamples."""
    ends, by_time = _ends(equations, durations)
    (count, width, d), samples, order = ends.shape, maps.shape[1], equations.order
    result = np.zeros((2, count, samples))
    jacobian = np.zeros((2, count, samples, count))
    change = np.empty(count)
    for k in range(2):
        for s in range(count):
            scales = durations[s] ** (order - (k + 1.0))
            for i in range(samples):
                row = maps[k, i] * scales
                for m in range(d):
                    x = 0.0
                    change[:] = 0.0
                    for j in range(width):
                        x += row[j] * ends[s, j, m]
                        change[s] += row[j] * (order[j] - k - 1) / durations[s] * ends[s, j, m]
                        change += row[j] * by_time[s, j, m]
                    result[k, s, i] += x * x
                    jacobian[k, s, i] += 2.0 * x * change
    return result.ravel(), jacobian.reshape(-1, count)


@compilable
def _ends(equations, durations):
    """Returns the ends of segments, (segments, 2n, d), and their Jacobian by the durations.

    For the free derivatives x, H x + g = 0, hence dx = -H^-1 (dH x + dg).
    """
    rows, order = equations.rows, equations.order
    (d, size), (count, width) = equations.values.shape, rows.shape
    segments, hessian, scale = _assemble(equations, durations)
    ends = np.empty((count, width, d))
    by_time = np.zeros((count, width, d, count))
    for m in range(d):
        free, factor, linear = _factorize(equations, m, segments, hessian, scale)
        x = equations.values[m].copy()
        x[free] = scale[free] * solve_cholesky(factor, linear)
        for s in range(count):
            ends[s, :, m] = x[rows[s]]
        ends[-1, width // 2, m] += equations.offset[m]
        for s in range(count):
            change = np.zeros(size)
            for i in range(width):
                by_duration = segments[s, i] * (equations.power + order[i] + order) / durations[s]
                for j in range(width):
                    change[rows[s, i]] -= by_duration[j] * ends[s, j, m]
            dx = np.zeros(size)
            dx[free] = scale[free] * solve_cholesky(factor, scale[free] * change[free])
            for r in range(count):
                by_time[r, :, m, s] = dx[rows[r]]
    return ends, by_time
