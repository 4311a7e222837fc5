"""Trajectories in the flat outputs of a multirotor: x, y, z and yaw."""

import functools
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from pydrake.polynomial import Polynomial
from pydrake.trajectories import PiecewisePolynomial

from airrace.common.immutable import Immutable
from airrace.common.jit import assign, compilable, compiled
from airrace.trajopt.reference import (
    NO_LIFT,
    REFERENCE_SIZE,
    Reference,
    as_reference,
    reference_vector,
)


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
        self.__dict__["polynomial"] = polynomial
        self._set_segments(
            np.array(polynomial.get_segment_times()), segment_coefficients(polynomial)
        )

    def _set_segments(self, breaks: np.ndarray, coefficients: np.ndarray) -> None:
        self.breaks = tuple(breaks.tolist())
        self.duration = self.breaks[-1]
        self._breaks, self._coefficients = breaks, coefficients

    @classmethod
    def of_segments(cls, breaks: np.ndarray, coefficients: np.ndarray) -> "FlatTrajectory":
        """Returns the trajectory with breaks, (n + 1,) s, and segment_coefficients(), (n, 4, m).

        Drake's polynomial, which takes milliseconds to make, is made if it is asked for.
        """
        trajectory = cls.__new__(cls)
        trajectory._set_segments(breaks, coefficients)
        return trajectory

    @property
    def segments(self) -> tuple[np.ndarray, np.ndarray]:
        """Breaks, (n + 1,) s, and segment_coefficients(), (n, 4, m)."""
        return self._breaks, self._coefficients

    @functools.cached_property
    def polynomial(self) -> PiecewisePolynomial:
        """See the attributes."""
        return piecewise_polynomial(self._coefficients, self._breaks)

    def __getstate__(self) -> dict:
        # To unpickle Drake's would take milliseconds, which a control loop does not have.
        return {name: v for name, v in self.__dict__.items() if name != "polynomial"}

    @classmethod
    def resting(cls, pose: ArrayLike) -> "FlatTrajectory":
        """Returns the trajectory that stays at x, y, z and yaw, (4,), for 1 ms."""
        return cls(PiecewisePolynomial.ZeroOrderHold([0.0, 1e-3], np.column_stack([pose, pose])))

    def derivatives(self, time: float, count: int = 5) -> np.ndarray:
        """Returns the value and its derivatives, (count, 4).

        Times beyond either end are clamped.
        """
        return _evaluate(self._breaks, self._coefficients, float(time))[:count]

    def reference(self, time: float) -> np.ndarray:
        """Returns the sample at a time, a Reference as a vector (18,).

        Beyond the end it is the end point, at rest.
        """
        return _reference(self._breaks, self._coefficients, float(time))

    def positions(self, times: ArrayLike) -> np.ndarray:
        """Returns the positions at many times, (3, N) m."""
        return as_reference(self.sample(times)).position

    def sample(self, times: ArrayLike) -> np.ndarray:
        """Returns samples at many times, References as vectors, (18, N)."""
        d = _evaluate_all(self._breaks, self._coefficients, np.asarray(times, float))
        return pack(d.swapaxes(0, 1))


def segment_coefficients(polynomial: PiecewisePolynomial) -> np.ndarray:
    """Returns coefficients in time since each segment's start, constants first, (n, 4, k)."""
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


def piecewise_polynomial(coefficients: np.ndarray, breaks: np.ndarray) -> PiecewisePolynomial:
    """Returns the trajectory with segment_coefficients() and breaks, (n + 1,) s."""
    pieces = [np.array([[Polynomial(c)] for c in piece]) for piece in coefficients]
    return PiecewisePolynomial(pieces, breaks)


@compiled
def _evaluate_all(breaks, coefficients, times):
    """Returns value and derivatives at times, (n, 5, 4); see _evaluate()."""
    out = np.empty((len(times), 5, 4))
    for i in range(len(times)):
        out[i] = _evaluate(breaks, coefficients, times[i])
    return out


@compiled
def _evaluate(breaks, coefficients, time):
    """Returns value and derivatives at a time, clamped, (5, 4): Horner's rule."""
    out, time = np.zeros((5, 4)), min(max(time, breaks[0]), breaks[-1])
    segment = min(np.searchsorted(breaks, time, side="right"), len(breaks) - 1) - 1
    t = time - breaks[segment]
    for d in range(4):
        for c in range(coefficients.shape[2] - 1, -1, -1):
            for order in range(4, 0, -1):
                out[order, d] = out[order, d] * t + order * out[order - 1, d]
            out[0, d] = out[0, d] * t + coefficients[segment, d, c]
    return out


@compiled
def _reference(breaks, coefficients, time):
    """Returns the sample at a time, (18,); see FlatTrajectory.reference()."""
    d = _evaluate(breaks, coefficients, time)
    if time > breaks[-1]:
        d[1:] = 0.0
    return flat_outputs(d)


@compilable
def flat_outputs(derivatives: np.ndarray) -> np.ndarray:
    """Packs value and four derivatives of x, y, z, yaw, (5, 4), into (18,)."""
    vector = np.empty(REFERENCE_SIZE)
    for order in range(5):
        assign(vector[3 * order :][:3], derivatives[order])
    assign(vector[15:], derivatives[:, 3])
    return vector


def pack(derivatives: np.ndarray) -> np.ndarray:
    """Returns samples (5, N, 4) as References, (18, N)."""
    xyz, yaw = np.swapaxes(derivatives[..., :3], 1, 2), derivatives[:3, :, 3]
    return np.vstack(Reference(*xyz, *yaw))


def unpack_flat_outputs(reference: np.ndarray) -> np.ndarray:
    """Returns value and four derivatives of x, y, z and yaw, (5, 4), of a sample (18,).

    Those of yaw beyond the second are not part of a sample: zero.
    """
    *xyz, yaw, yaw_rate, yaw_acceleration = as_reference(reference)
    return np.column_stack([xyz, [yaw, yaw_rate, yaw_acceleration, 0.0, 0.0]])


def hold(p_WB: Sequence[float] | np.ndarray, yaw: float) -> np.ndarray:
    """Returns the reference of hovering at a point p_WB (m) with a yaw (rad), (18,)."""
    return reference_vector(Reference(p_WB, 0.0, 0.0, 0.0, 0.0, yaw, 0.0, 0.0))  # type: ignore[arg-type]


def idle(p_WB: Sequence[float] | np.ndarray, yaw: float) -> np.ndarray:
    """Returns the reference of a drone that stands, at a point p_WB (m) with a yaw (rad), (18,).

    The rotors stand still. With any thrust, and an attitude to hold, a drone would slide on a
    tilted pad, and one that is wrong about its attitude would turn over.
    """
    reference = hold(p_WB, yaw)
    as_reference(reference).acceleration[2] = 2.0 * NO_LIFT
    return reference
