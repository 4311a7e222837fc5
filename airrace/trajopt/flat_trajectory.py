"""Trajectories in the flat outputs of a multirotor: x, y, z and yaw."""

import numpy as np
from pydrake.trajectories import PiecewisePolynomial

from airrace.common.immutable import Immutable
from airrace.common.jit import compilable, compiled

# A sample of the flat outputs and their derivatives: the vector `reference`.
SIZE = 18
POSITION = slice(0, 3)
VELOCITY = slice(3, 6)
ACCELERATION = slice(6, 9)
JERK = slice(9, 12)
SNAP = slice(12, 15)
YAW, YAW_RATE, YAW_ACCELERATION = 15, 16, 17


class FlatTrajectory(Immutable):
    """A PiecewisePolynomial of x, y, z (m, world) and yaw (rad), from time 0.

    Controllers and checks ask for all derivatives, at thousands of times: so they are
    evaluated here, all at once.

    Attributes:
        polynomial: the value, four rows.
        duration: (s).
        breaks: when each segment starts, and the duration, as a tuple (s).
    """

    def __init__(self, polynomial: PiecewisePolynomial):
        """Args: polynomial: with four rows, starting at time 0."""
        self.polynomial = polynomial
        self.breaks = tuple(polynomial.get_segment_times())
        self.duration = self.breaks[-1]
        self._breaks, self._coefficients = np.array(self.breaks), _coefficients(polynomial)

    @classmethod
    def resting(cls, pose) -> "FlatTrajectory":
        """Returns the trajectory that stays at x, y, z and yaw, (4,), for 1 ms."""
        return cls(PiecewisePolynomial.ZeroOrderHold([0.0, 1e-3], np.column_stack([pose, pose])))

    def derivatives(self, time: float, count: int = 5) -> np.ndarray:
        """Returns the value and its derivatives, (count, 4).

        Times beyond either end are clamped.
        """
        return _derivatives(self._breaks, self._coefficients, float(time))[:count]

    def reference(self, time: float) -> np.ndarray:
        """Returns the sample at a time, as laid out above, shape (18,).

        Beyond the end it is the end point, at rest.
        """
        return _reference(self._breaks, self._coefficients, float(time))

    def positions(self, times) -> np.ndarray:
        """Returns the positions at many times, (3, N) m."""
        return self.sample(times)[POSITION]

    def sample(self, times) -> np.ndarray:
        """Returns samples at many times, shape (18, N)."""
        return _samples(self._breaks, self._coefficients, np.asarray(times, float))


def _coefficients(polynomial: PiecewisePolynomial) -> np.ndarray:
    """Returns those of all segments, in time since their start, constants first, (n, 4, k)."""
    pieces = [
        [p.GetCoefficients() for p in polynomial.getPolynomialMatrix(i).ravel()]
        for i in range(polynomial.get_number_of_segments())
    ]
    most = max(len(each) for piece in pieces for each in piece)
    result = np.zeros((len(pieces), len(pieces[0]), most))
    for i, piece in enumerate(pieces):
        for d, each in enumerate(piece):
            result[i, d, : len(each)] = each
    return result


@compilable
def _evaluate(breaks, coefficients, time, out) -> None:
    """Puts value and derivatives at a time, clamped, into out, (5, 4): Horner's rule."""
    segment, last = 0, len(breaks) - 2
    time = min(max(time, breaks[0]), breaks[last + 1])
    while segment < last:  # halves what is left
        middle = (segment + last + 1) // 2
        if breaks[middle] <= time:
            segment = middle
        else:
            last = middle - 1
    t = time - breaks[segment]
    for d in range(4):
        out[:, d] = 0.0
        for c in range(coefficients.shape[2] - 1, -1, -1):
            for order in range(4, 0, -1):
                out[order, d] = out[order, d] * t + order * out[order - 1, d]
            out[0, d] = out[0, d] * t + coefficients[segment, d, c]


@compiled
def _derivatives(breaks, coefficients, time):
    """Returns value and derivatives at a time, (5, 4); see FlatTrajectory.derivatives()."""
    out = np.empty((5, 4))
    _evaluate(breaks, coefficients, time, out)
    return out


@compiled
def _reference(breaks, coefficients, time):
    """Returns the sample at a time, (18,); see FlatTrajectory.reference()."""
    d, result = np.empty((5, 4)), np.empty(SIZE)
    _evaluate(breaks, coefficients, time, d)
    if time > breaks[-1]:
        d[1:] = 0.0
    _pack(d, result)
    return result


@compiled
def _samples(breaks, coefficients, times):
    """Returns samples, (18, n); see FlatTrajectory.sample()."""
    result, d = np.empty((SIZE, len(times))), np.empty((5, 4))
    for i in range(len(times)):
        _evaluate(breaks, coefficients, times[i], d)
        _pack(d, result[:, i])
    return result


@compilable
def _pack(derivatives, reference) -> None:
    for order in range(5):
        for j in range(3):
            reference[3 * order + j] = derivatives[order, j]
    for order in range(3):
        reference[YAW + order] = derivatives[order, 3]


@compiled
def flat_outputs(derivatives) -> np.ndarray:
    """Packs value and four derivatives of x, y, z, yaw, (5, 4), into (18,)."""
    reference = np.empty(SIZE)
    _pack(derivatives, reference)
    return reference


def unpack_flat_outputs(reference) -> np.ndarray:
    """Returns value and four derivatives of x, y, z and yaw, (5, 4), of a sample (18,).

    Those of yaw beyond the second are not part of a sample: zero.
    """
    xyz = reference[:YAW].reshape(5, 3)
    return np.column_stack([xyz, [*reference[YAW:], 0.0, 0.0]])


def hold(p_WB, yaw: float) -> np.ndarray:
    """Returns the reference of hovering at a point, shape (18,).

    Args:
        p_WB: (3,) in the world (m).
        yaw: (rad).
    """
    result = np.zeros(SIZE)
    result[POSITION], result[YAW] = p_WB, yaw
    return result
