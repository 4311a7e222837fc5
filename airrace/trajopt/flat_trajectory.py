"""Trajectories in the flat outputs of a multirotor: x, y, z and yaw."""

import functools

import numpy as np
from pydrake.trajectories import PiecewisePolynomial

from airrace.immutable import Immutable

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

    Attributes:
        duration: (s).
        breaks: when each segment starts, and the duration, as a tuple (s).
    """

    def __init__(self, polynomial: PiecewisePolynomial):
        """Args: polynomial: with four rows, starting at time 0."""
        self.breaks = tuple(polynomial.get_segment_times())
        self.duration = self.breaks[-1]
        self._polynomials = [polynomial.derivative(order) for order in range(5)]

    @classmethod
    def resting(cls, pose) -> "FlatTrajectory":
        """Returns the trajectory that stays at x, y, z and yaw, (4,), for 1 ms."""
        return cls(PiecewisePolynomial.ZeroOrderHold([0.0, 1e-3], np.column_stack([pose, pose])))

    def derivatives(self, time: float, count: int = 5) -> np.ndarray:
        """Returns the value and its derivatives, (count, 4).

        Times beyond either end are clamped.
        """
        return self._stack.value(time).reshape(5, 4)[:count]

    @property
    def polynomial(self) -> PiecewisePolynomial:
        """Of the value: four rows."""
        return self._polynomials[0]

    @functools.cached_property
    def _stack(self) -> PiecewisePolynomial:
        """Value and derivatives below each other: one look-up for all."""
        return PiecewisePolynomial(
            [np.vstack([p.getPolynomialMatrix(i) for p in self._polynomials])
             for i in range(len(self.breaks) - 1)],
            self.breaks,
        )

    def reference(self, time: float) -> np.ndarray:
        """Returns the sample at a time, as laid out above, shape (18,).

        Beyond the end it is the end point, at rest.
        """
        d = self.derivatives(time)
        if time > self.duration:
            d[1:] = 0.0
        return flat_outputs(d)

    def positions(self, times) -> np.ndarray:
        """Returns the positions at many times, (3, N) m."""
        return self._polynomials[0].vector_values(times)[:3]

    def sample(self, times) -> np.ndarray:
        """Returns samples at many times, shape (18, N)."""
        d = [p.vector_values(times) for p in self._polynomials]
        return np.vstack([*(row[:3] for row in d), *(row[3] for row in d[:3])])


def flat_outputs(derivatives) -> np.ndarray:
    """Packs value and four derivatives of x, y, z, yaw, (5, 4), into (18,)."""
    return np.concatenate([derivatives[:, :3].ravel(), derivatives[:3, 3]])


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
