"""What a client of the flight controller wants of the drone, as a vector that crosses ports."""

from typing import NamedTuple

import numpy as np

from airrace.common.packing import Packing

# What a set-point is about.
IDLE, RATES, ATTITUDE, VELOCITY, POSITION, MOTORS = range(6)


class Setpoint(NamedTuple):
    """A set-point; W is the world, z up, and B the body, x forward, y left."""

    kind: float  #: see above; numbers that are not of its kind do not matter
    time: float  #: when it came (s)
    armed: float  #: 1 if the motors may turn, 0 if not
    thrust: float  #: of RATES and ATTITUDE, as a share of all that the rotors have, 0 to 1
    yaw: float  #: of VELOCITY and POSITION, from the world's x axis (rad)
    #: 1 if yaw, or that of the quaternion, matters; with 0, the drone turns at yaw_rate, or with
    #: an ATTITUDE as its rates say
    has_yaw: float
    yaw_rate: float  #: about the vertical (rad/s)
    #: of RATES, in B (rad/s), (3,); of ATTITUDE, on top of what leads there
    rates: np.ndarray
    quaternion: np.ndarray  #: of ATTITUDE, of R_WB, (4,)
    position: np.ndarray  #: of POSITION, p_WB (m), (3,)
    velocity: np.ndarray  #: of VELOCITY, v_WB; of POSITION, on top of what leads there (m/s), (3,)
    #: of VELOCITY and POSITION, on top of what leads there (m/s^2), (3,)
    acceleration: np.ndarray
    #: has_position, has_velocity: 1 along axes of W where the position matters, and where a
    #: velocity does, (3,); along the others, nothing but the rest leads the drone
    has_position: np.ndarray
    has_velocity: np.ndarray
    motors: np.ndarray  #: of MOTORS, thrusts as shares of each rotor's greatest, 0 to 1, (4,)


_LEVEL, _ZERO, _ALL, _STILL = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), np.ones(3), np.zeros(4)
NO_SETPOINT = Setpoint(*7 * [0.0], _ZERO, _LEVEL, _ZERO, _ZERO, _ZERO, _ALL, _ALL, _STILL)  # type: ignore[arg-type, call-arg]
_PACKING = Packing(
    Setpoint,
    rates=3,
    quaternion=4,
    position=3,
    velocity=3,
    acceleration=3,
    has_position=3,
    has_velocity=3,
    motors=4,
)
as_setpoint, setpoint_vector, SETPOINT_SIZE = _PACKING.parts, _PACKING.vector, _PACKING.size
