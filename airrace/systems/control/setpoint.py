"""What a client of the flight controller wants of the drone, as a vector that crosses ports."""

from typing import NamedTuple

import numpy as np

from airrace.common.packing import Packing

# What a set-point is about.
IDLE, RATES, ATTITUDE, VELOCITY, POSITION, MOTORS = range(6)


class Setpoint(NamedTuple):
    """A set-point; W is the world, z up, and B the body, x forward, y left.

    Attributes:
        kind: see above; numbers that are not of its kind do not matter.
        time: when it came (s).
        armed: 1 if the motors may turn, 0 if not.
        thrust: of RATES and ATTITUDE, as a share of all that the rotors have, 0 to 1.
        yaw: of VELOCITY and POSITION, from the world's x axis (rad).
        has_yaw: 1 if yaw matters; with 0, the drone turns at yaw_rate.
        yaw_rate: about the vertical (rad/s).
        rates: of RATES, in B (rad/s), (3,).
        quaternion: of ATTITUDE, of R_WB, (4,).
        position: of POSITION, p_WB (m), (3,).
        velocity: of VELOCITY, v_WB; of POSITION, on top of what leads there (m/s), (3,).
        motors: of MOTORS, thrusts as shares of each rotor's greatest, 0 to 1, (4,).
    """

    kind: float
    time: float
    armed: float
    thrust: float
    yaw: float
    has_yaw: float
    yaw_rate: float
    rates: np.ndarray
    quaternion: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    motors: np.ndarray


_LEVEL, _ZERO, _STILL = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), np.zeros(4)
NO_SETPOINT = Setpoint(*7 * [0.0], _ZERO, _LEVEL, _ZERO, _ZERO, _STILL)  # type: ignore[arg-type, call-arg]
_PACKING = Packing(Setpoint, rates=3, quaternion=4, position=3, velocity=3, motors=4)
as_setpoint, setpoint_vector, SETPOINT_SIZE = _PACKING.parts, _PACKING.vector, _PACKING.size
