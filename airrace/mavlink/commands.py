"""What a client commands, in MAVLink, as set-points.

Fields that a message's type_mask says to ignore may hold anything. All others must be finite.
"""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from airrace.mavlink.frames import flipped, flipped_quaternion
from airrace.systems.control.setpoint import (
    ATTITUDE,
    MOTORS,
    NO_SETPOINT,
    POSITION,
    RATES,
    VELOCITY,
    Setpoint,
)

RESET = 31000  # MAV_CMD_USER_1: resets the simulation
ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
SET_MODE = mavlink.MAV_CMD_DO_SET_MODE  # set-points are followed in every mode
SETPOINTS = ("SET_ATTITUDE_TARGET", "SET_POSITION_TARGET_LOCAL_NED", "SET_ACTUATOR_CONTROL_TARGET")
_IGNORE_ATTITUDE = mavlink.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE
_IGNORE_POSITION = (
    mavlink.POSITION_TARGET_TYPEMASK_X_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Y_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Z_IGNORE
)
_IGNORE_VELOCITY = (
    mavlink.POSITION_TARGET_TYPEMASK_VX_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_VY_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_VZ_IGNORE
)
_IGNORE_YAW = mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE
_IGNORE_YAW_RATE = mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
_UNITED = 1e-3  # m; a quaternion shorter than this has no direction


class RefusedError(ValueError):
    """A command that cannot be obeyed: a number is not finite, or it says nothing."""


def setpoint_of(message: Any, origin: np.ndarray, inverted_rates: bool = False) -> Setpoint:
    """Returns the set-point of a message, with neither time nor armed.

    Args: message: a MAVLink message, one of SETPOINTS. origin: of LOCAL_NED in the world (m), (3,).
    inverted_rates: whether rates of roll and yaw have the opposite sign of NED's.

    Raises RefusedError if it cannot be obeyed.
    """
    kind = message.get_type()
    if kind == "SET_ATTITUDE_TARGET":
        return _attitude(message, inverted_rates)
    if kind == "SET_POSITION_TARGET_LOCAL_NED":
        return _position(message, origin, inverted_rates)
    motors = np.clip(_finite(message.controls[:4]), 0.0, 1.0)
    return NO_SETPOINT._replace(kind=MOTORS, motors=motors)


def signed_rates(rates: np.ndarray, inverted: bool) -> np.ndarray:
    """Returns rates about x, y and z, (3,), with roll and yaw inverted or not."""
    return rates * [-1.0, 1.0, -1.0] if inverted else rates


def _attitude(message, inverted):
    thrust = min(max(_finite([message.thrust])[0], 0.0), 1.0)
    if message.type_mask & _IGNORE_ATTITUDE:
        rates = _finite([message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate])
        # Rates of their own that are to be ignored are none.
        ignored = np.array([message.type_mask & bit for bit in (1, 2, 4)]) > 0
        rates = flipped(signed_rates(np.where(ignored, 0.0, rates), inverted))
        return NO_SETPOINT._replace(kind=RATES, thrust=thrust, rates=rates)
    q = _finite(message.q)
    length = float(np.linalg.norm(q))
    if length < _UNITED:
        raise RefusedError("the quaternion of an attitude is zero")
    quaternion = flipped_quaternion(q / length)
    return NO_SETPOINT._replace(kind=ATTITUDE, thrust=thrust, quaternion=quaternion)


def _position(message, origin, inverted):
    mask = message.type_mask
    has_position = (mask & _IGNORE_POSITION) != _IGNORE_POSITION
    has_velocity = (mask & _IGNORE_VELOCITY) != _IGNORE_VELOCITY
    if not (has_position or has_velocity):
        raise RefusedError("a set-point has neither position nor velocity")
    velocity = np.zeros(3)
    if has_velocity:
        velocity = flipped(_finite([message.vx, message.vy, message.vz]))
    setpoint = NO_SETPOINT._replace(kind=VELOCITY, velocity=velocity)
    if has_position:
        place = origin + flipped(_finite([message.x, message.y, message.z]))
        setpoint = setpoint._replace(kind=POSITION, position=place)
    if not mask & _IGNORE_YAW:
        return setpoint._replace(yaw=-_finite([message.yaw])[0], has_yaw=1.0)
    if not mask & _IGNORE_YAW_RATE:
        rate = _finite([message.yaw_rate])[0]
        return setpoint._replace(yaw_rate=rate if inverted else -rate)
    return setpoint


def _finite(numbers: Iterable[float]) -> np.ndarray:
    values = [float(number) for number in numbers]
    if not all(map(math.isfinite, values)):
        raise RefusedError("a number is not finite")
    return np.array(values)
