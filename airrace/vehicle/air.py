"""The air as a drone knows it: what its drag is, and the mean wind."""

import math
from typing import NamedTuple

import numpy as np

from airrace.common.jit import compilable
from airrace.common.packing import Packing
from airrace.math.vec3 import dot


class Air(NamedTuple):
    """Drag that is the same in all directions but the thrust's, and the wind.

    At a velocity u through the air, with z the axis of the thrust, the drag by mass is
    -(linear + quadratic |u|) u - (axial_linear + axial_quadratic |u|) (u . z) z.
    """

    linear: float  #: 1/s
    quadratic: float  #: 1/m
    wind: np.ndarray  #: m/s, in the world, (3,)
    #: axial_linear (1/s), axial_quadratic (1/m): how much more there is along the thrust. A drone
    #: with a plate on top has more, one with large rotors may have less.
    axial_linear: float = 0.0
    axial_quadratic: float = 0.0

    @property
    def is_still(self) -> bool:
        """Whether there is no drag."""
        return self.linear == 0.0 and self.quadratic == 0.0


_PACKING = Packing(Air, wind=3)
as_air, air_vector, AIR_SIZE = _PACKING.parts, _PACKING.vector, _PACKING.size
STILL = Air(0.0, 0.0, np.zeros(3))
STILL_VECTOR = air_vector(STILL)  # for ports that are left open


@compilable
def drag_acceleration(velocity: np.ndarray, z_B: np.ndarray, air: Air) -> np.ndarray:
    """Returns what drag does to a drone (m/s^2, in the world), (3,).

    Args: velocity: of the drone (m/s, in the world), (3,). z_B: axis of its thrust, likewise.
    """
    u = velocity - air.wind
    speed = math.sqrt(u[0] ** 2 + u[1] ** 2 + u[2] ** 2)
    along = (air.axial_linear + air.axial_quadratic * speed) * dot(u, z_B)
    return -(air.linear + air.quadratic * speed) * u - along * z_B


@compilable
def drag_rate(velocity: np.ndarray, acceleration: np.ndarray, air: Air) -> np.ndarray:
    """Returns the derivative of drag, without that along the thrust, (m/s^3), (3,).

    Args: velocity, acceleration: of the drone, in the world, (3,).
    """
    v, a = velocity - air.wind, acceleration
    speed = max(math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2), 1e-3)
    along = (v[0] * a[0] + v[1] * a[1] + v[2] * a[2]) / speed
    return -(air.linear + air.quadratic * speed) * a - air.quadratic * along * v
