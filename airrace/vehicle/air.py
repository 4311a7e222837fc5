"""The air as a drone knows it: what its drag is, and the mean wind."""

import math
from typing import NamedTuple

import numpy as np

from airrace.common.jit import compilable
from airrace.common.packing import Packing


class Air(NamedTuple):
    """Drag that is the same in all directions, and the wind.

    At a velocity v the drag by mass is -(linear + quadratic |v - wind|) (v - wind).
    """

    linear: float  #: 1/s
    quadratic: float  #: 1/m
    wind: np.ndarray  #: m/s, in the world, (3,)

    @property
    def is_still(self) -> bool:
        """Whether there is no drag."""
        return self.linear == 0.0 and self.quadratic == 0.0


_PACKING = Packing(Air, wind=3)
as_air, air_vector, AIR_SIZE = _PACKING.parts, _PACKING.vector, _PACKING.size
STILL = Air(0.0, 0.0, np.zeros(3))


@compilable
def drag_acceleration(velocity: np.ndarray, air: Air) -> np.ndarray:
    """Returns what drag does to a drone (m/s^2, in the world), (3,).

    Args: velocity: of the drone (m/s, in the world), (3,).
    """
    v = velocity - air.wind
    return -(air.linear + air.quadratic * math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)) * v


@compilable
def drag_rate(velocity: np.ndarray, acceleration: np.ndarray, air: Air) -> np.ndarray:
    """Returns the derivative of drag_acceleration() (m/s^3), (3,).

    Args: velocity, acceleration: of the drone, in the world, (3,).
    """
    v, a = velocity - air.wind, acceleration
    speed = max(math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2), 1e-3)
    along = (v[0] * a[0] + v[1] * a[1] + v[2] * a[2]) / speed
    return -(air.linear + air.quadratic * speed) * a - air.quadratic * along * v
