"""The layout of the vector in which a trajectory's flat outputs cross ports."""

from typing import NamedTuple

import numpy as np

from airrace.common.packing import Packing
from airrace.vehicle import GRAVITY

# m/s^2. No rotor, and no disturbance of a race, lets a drone accelerate downwards like that: who
# asks for it wants nothing of the rotors, see idle().
NO_LIFT = -2.0 * GRAVITY


class Reference(NamedTuple):
    """The flat outputs of a multirotor, and their derivatives, at one time or at N.

    Its vector is (18,), that of N samples (18, N), by ``np.vstack(reference)``. With a vertical
    acceleration below NO_LIFT, it asks for nothing: rotors stand still, see flat_trajectory.idle().
    """

    position: np.ndarray  #: in the world, p_WB (m), (3,)
    #: velocity, acceleration, jerk, snap: its derivatives (m/s, ..., m/s^4), (3,)
    velocity: np.ndarray
    acceleration: np.ndarray
    jerk: np.ndarray
    snap: np.ndarray
    yaw: float  #: of the body's x axis (rad)
    #: yaw_rate, yaw_acceleration: its derivatives (rad/s, rad/s^2)
    yaw_rate: float
    yaw_acceleration: float


_PACKING = Packing(Reference, position=3, velocity=3, acceleration=3, jerk=3, snap=3)
as_reference, reference_vector, REFERENCE_SIZE = _PACKING.parts, _PACKING.vector, _PACKING.size
