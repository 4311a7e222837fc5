"""How near minimum-snap trajectories come to limits of speed and acceleration."""

from math import perm

import numpy as np

from airrace.common.jit import compilable, compiled
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.flat_trajectory import segment_coefficients
from airrace.trajopt.min_snap.min_snap import MinSnapProblem, unit_segment

_SAMPLES = 50  # of a segment, which bracket the peaks
_REFINED, _ROUNDS = 17, 4  # samples about a peak, and how often they are drawn closer
_NEAR = 0.95  # of the greatest sample: lesser peaks are not refined


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
    coefficients = problem.coefficients(durations, problem.solve(durations))
    speed, acceleration = _peaks(coefficients, durations)
    return max(speed / limits[0], (acceleration / limits[1]) ** 0.5)


def peak_speed_and_acceleration(trajectory) -> tuple[float, float]:
    """Returns the greatest speed (m/s) and acceleration (m/s^2) of a trajectory.

    Both are norms over x, y, z, without gravity, good to about nine digits.

    Args:
        trajectory: PiecewisePolynomial whose first three rows are x, y, z.
    """
    durations = np.diff(trajectory.get_segment_times())
    coefficients = np.swapaxes(segment_coefficients(trajectory)[:, :3], 1, 2)
    coefficients = (
        coefficients * durations[:, None, None] ** np.arange(coefficients.shape[1])[:, None]
    )
    return _peaks(coefficients, durations)


def _peaks(coefficients, durations) -> tuple[float, float]:
    coefficients = np.ascontiguousarray(coefficients[..., :3])
    return tuple(_peak_norm(coefficients, durations, k) for k in (1, 2))


@compiled
def _peak_norm(coefficients, durations, derivative):
    """Returns the greatest norm of a derivative of polynomials, to about nine digits.

    Args:
        coefficients: of powers of t / duration, (segments, k, d).
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
    for column in coefficients.T:
        values = np.zeros(len(fractions))
        for i in range(len(column) - 1, derivative - 1, -1):
            factor = i if derivative == 1 else i * (i - 1)
            values = values * fractions + factor * column[i]
        squares += values * values
    return np.sqrt(squares) / duration**derivative


class LimitSamples:
    """|v|^2 / v_max^2 and |a|^2 / a_max^2 at samples, as functions of the durations."""

    def __init__(self, problem: MinSnapProblem, limits, samples: int):
        """Args: problem: see there. limits: of v and a. samples: a segment."""
        self._problem = problem
        basis, _ = unit_segment(problem.degree, problem.minimized_derivative)
        fractions, powers = np.linspace(0, 1, samples), range(len(basis))
        # From derivatives at a segment's ends, times duration^order, to its samples of velocity
        # and acceleration, times duration and its square, as shares of the limits.
        self._maps = np.array(
            [
                np.array([[perm(j, k) * t ** max(j - k, 0) for j in powers] for t in fractions])
                @ basis
                / limits[k - 1]
                for k in (1, 2)
            ]
        )

    def __call__(self, durations):
        """Returns the samples, (count,), and their Jacobian, (count, segments).

        Args:
            durations: of the segments (s).

        Returns:
            two arrays, of NaN if the durations are too unlike each other.
        """
        problem, T = self._problem, durations[:, None, None]
        try:
            x, x_by_T = problem.solve_with_jacobian(durations)
        except TrajectoryOptimizationError:
            count = self._maps[..., 0].size * len(T)
            return np.full(count, np.nan), np.full((count, len(T)), np.nan)
        ends, each = problem.ends(x), np.arange(len(durations))
        ends_by_T = x_by_T[problem.rows].reshape(*ends.shape[:2], -1)
        values, jacobians = [], []
        for k, sampled in zip((1, 2), self._maps):
            rows = sampled * T ** (problem.order - float(k))  # (segments, samples, 2n)
            y = rows @ ends
            y_by_T = (rows @ ends_by_T).reshape(*y.shape, -1)
            y_by_T[each, ..., each] += rows * ((problem.order - k) / T) @ ends
            values.append(np.sum(y * y, axis=2).ravel())
            jacobians.append(2.0 * np.einsum("sim,simr->sir", y, y_by_T).reshape(-1, len(each)))
        return np.concatenate(values), np.concatenate(jacobians)
