"""How near minimum-snap trajectories come to limits of speed and acceleration."""

from math import perm

import numpy as np

from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.flat_trajectory import segment_coefficients
from airrace.trajopt.min_snap.min_snap import MinSnapProblem

_SAMPLES = 50  # of a segment, which bracket the peaks
_STEPS = np.linspace(-1.0, 1.0, 33)  # samples about a peak, drawn closer and closer:
_WIDTHS = 1.0 / _SAMPLES / 16.0 ** np.arange(3)
_NEAR = 0.9  # of the greatest square: lesser peaks are not refined


def slowdown_factor(problem: MinSnapProblem, durations, limits) -> float:
    """Returns the greatest of speed / limit and sqrt(acceleration / limit) on a trajectory.

    That is how many times slower it must be flown along the same path. The arguments and what it
    raises are those of durations_within_limits().
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
    """Returns the greatest norms of velocity and acceleration of x, y, z.

    Args: coefficients: of powers of t / duration, (segments, k, d). durations: (segments,) s.
    """
    peaks = []
    for _ in range(2):
        powers = np.arange(1.0, coefficients.shape[1])[:, None] / durations[:, None, None]
        coefficients = powers * coefficients[:, 1:, :3]
        peaks.append(_peak_norm(coefficients))
    return tuple(peaks)


def _peak_norm(coefficients) -> float:
    """Returns the greatest norm of polynomials between 0 and 1, to about nine digits.

    Args: coefficients: constants first, (segments, k, 3).
    """
    powers = np.arange(coefficients.shape[1])

    def squares(fractions, coefficients):
        return np.square(fractions[..., None] ** powers @ coefficients).sum(axis=-1)

    at = np.arange(_SAMPLES + 1) / _SAMPLES
    found = squares(at, coefficients)
    is_peak, rises = found >= _NEAR * found.max(), np.diff(found, axis=1) >= 0.0
    is_peak[:, 1:] &= rises
    is_peak[:, :-1] &= found[:, :-1] >= found[:, 1:]
    segment, i = np.nonzero(is_peak)
    at, each = at[i], np.arange(len(i))
    for width in _WIDTHS:
        finer = np.clip(at[:, None] + width * _STEPS, 0.0, 1.0)
        found = squares(finer, coefficients[segment])
        at = finer[each, found.argmax(axis=1)]
    return float(np.sqrt(found.max()))


class LimitSamples:
    """|v|^2 / v_max^2 and |a|^2 / a_max^2 at samples, as functions of the durations."""

    def __init__(self, problem: MinSnapProblem, limits, samples: int):
        """Args: problem: see there. limits: of v and a. samples: a segment."""
        self._problem = problem
        fractions, powers = np.linspace(0, 1, samples), range(len(problem.basis))
        # From derivatives at a segment's ends, times duration^order, to its samples of velocity
        # and acceleration, times duration and its square, as shares of the limits.
        self._maps = np.array(
            [
                np.array([[perm(j, k) * t ** max(j - k, 0) for j in powers] for t in fractions])
                @ problem.basis
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
            x = problem.solve(durations)
            x_by_T = problem.jacobian(durations, x)
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
