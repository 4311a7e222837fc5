"""The layout of the vector in which a trajectory's flat outputs cross ports."""

from typing import NamedTuple

import numpy as np

from airrace.common.jit import compilable
from airrace.vehicle import GRAVITY

REFERENCE_SIZE = 18
# m/s^2. No rotor, and no disturbance of a race, lets a drone accelerate downwards like that: who
# asks for it wants nothing of the rotors, see idle().
NO_LIFT = -2.0 * GRAVITY


class Reference(NamedTuple):
    """The flat outputs of a multirotor, and their derivatives, at one time or at N.

    Compiled functions can make and read it. ``np.hstack(reference)`` is its vector (18,);
    ``np.vstack(reference)`` that of N samples, (18, N). With a vertical acceleration below NO_LIFT,
    it asks for nothing: rotors stand still, see flat_trajectory.idle().

    Attributes:
        position: in the world, p_WB (m), (3,).
        velocity, acceleration, jerk, snap: its derivatives (m/s, ..., m/s^4), (3,).
        yaw: of the body's x axis (rad).
        yaw_rate, yaw_acceleration: its derivatives (rad/s, rad/s^2).
    """

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    jerk: np.ndarray
    snap: np.ndarray
    yaw: float
    yaw_rate: float
    yaw_acceleration: float


@compilable
def as_reference(vector: np.ndarray) -> Reference:
    """Returns the parts of a vector (18,), or of N, (18, N), as views of it."""
    return Reference(
        vector[0:3],
        vector[3:6],
        vector[6:9],
        vector[9:12],
        vector[12:15],
        vector[15],
        vector[16],
        vector[17],
    )
