"""How near minimum-snap trajectories come to limits of speed and acceleration."""

from math import perm

import numpy as np
from pydrake.trajectories import PiecewisePolynomial

from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.flat_trajectory import segment_coefficients
from airrace.trajopt.min_snap.min_snap import MinSnapProblem

_SAMPLES = 50  # of a segment, which bracket the peaks
_NEAR = 0.9  # of the greatest square: lesser peaks are not refined
_ROUNDS = 3  # of Newton's method, the last for its value alone


def slowdown_factor(problem: MinSnapProblem, durations: np.ndarray, limits: np.ndarray) -> float:
    """Returns the greatest of speed / limit and sqrt(acceleration / limit) on a trajectory.

    That is how many times slower it must be flown along the same path. The arguments and what it
    raises are those of durations_within_limits().
    """
    durations = problem.check_durations(durations)
    coefficients = problem.coefficients(durations, problem.solve_closed_form(durations))
    speed, acceleration = peak_norms(coefficients, durations)
    return float(max(speed / limits[0], (acceleration / limits[1]) ** 0.5))


def peak_speed_and_acceleration(trajectory: PiecewisePolynomial) -> tuple[float, float]:
    """Returns the greatest speed (m/s) and acceleration (m/s^2) of a trajectory.

    Both are norms over x, y, z, without gravity, good to about nine digits.

    Args: trajectory: PiecewisePolynomial whose first three rows are x, y, z.
    """
    durations = np.diff(trajectory.get_segment_times())
    coefficients = np.swapaxes(segment_coefficients(trajectory)[:, :3], 1, 2)
    coefficients = (
        coefficients * durations[:, None, None] ** np.arange(coefficients.shape[1])[:, None]
    )
    speed, acceleration = peak_norms(coefficients, durations)
    return float(speed), float(acceleration)


def peak_norms(coefficients: np.ndarray, durations: np.ndarray) -> np.ndarray:
    """Returns the greatest norms of velocity and acceleration of x, y, z, (2,) (m, s).

    Samples bracket the peaks. Newton's method finds where |p|^2 is level near them:
    (|p|^2)' / 2 = p . p' and (|p|^2)'' / 2 = p' . p' + p . p''.

    Args:
        coefficients: of powers of s = t / duration, (segments, k, d), as MinSnapProblem has them.
        durations: of the segments, (segments,) s.
    """
    powers = np.arange(float(coefficients.shape[1]))
    differentiate = np.diag(powers[1:], 1)
    derivatives = [differentiate @ coefficients[..., :3]]
    for _ in range(3):
        derivatives.append(differentiate @ derivatives[-1])
    # Of velocity and acceleration: values, and first and second derivatives by s.
    derivatives, T = np.array(derivatives), durations[:, None, None]
    p = np.array([derivatives[:3] / T, derivatives[1:] / T**2])

    samples = np.arange(_SAMPLES + 1) / _SAMPLES
    squares = np.square(samples[:, None] ** powers @ p[:, 0]).sum(axis=-1)
    greatest = squares.max(axis=(1, 2))
    is_peak = squares >= _NEAR * greatest[:, None, None]
    is_peak[..., 1:] &= squares[..., 1:] >= squares[..., :-1]
    is_peak[..., :-1] &= squares[..., :-1] >= squares[..., 1:]
    kind, segment, i = np.nonzero(is_peak)
    p, s = p[kind, :, segment], samples[i]
    least, most = samples[np.maximum(i - 1, 0)], samples[np.minimum(i + 1, _SAMPLES)]
    for _ in range(_ROUNDS):
        v = ((s[:, None] ** powers)[:, None, None] @ p)[:, :, 0]  # p, p' and p''
        products = v @ v.swapaxes(1, 2)
        slope, curvature = products[:, 0, 1], products[:, 1, 1] + products[:, 0, 2]
        step = np.divide(slope, curvature, out=np.zeros_like(s), where=curvature < 0.0)
        s = np.clip(s - step, least, most)
    np.maximum.at(greatest, kind, products[:, 0, 0])
    return np.sqrt(greatest)


class LimitSamples:
    """|v|^2 / v_max^2 and |a|^2 / a_max^2 at samples, as functions of the durations."""

    def __init__(self, problem: MinSnapProblem, limits: np.ndarray, samples: int):
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

    def __call__(self, durations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns the samples, (count,), and their Jacobian, (count, segments).

        Args: durations: of the segments (s).

        Returns: two arrays, of NaN if the durations are too unlike each other.
        """
        problem, T = self._problem, durations[:, None, None]
        try:
            x = problem.solve_closed_form(durations)
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
