"""What a client commands, in MAVLink, as set-points.

Fields that a message's type_mask says to ignore are never read. All others must be finite. What is
ignored keeps its last value, or is left to the autopilot:

- a thrust that is ignored is that of the last attitude or rates, or hovers;
- until there is a thrust, the motors stand still, whatever rates are wanted;
- a body rate that is ignored is none; beside an attitude, rates are on top of what leads there,
  and a yaw rate alone takes the place of the attitude's yaw;
- along an axis without position, velocity and acceleration, the drone stands still; with nothing
  but a yaw or its rate, the last position and velocity stay;
- without yaw and yaw rate, the drone keeps the last yaw of such a set-point, or looks where it
  does.
"""

import itertools
import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from airrace.mavlink.dialects import Dialect
from airrace.mavlink.frames import flipped, flipped_quaternion
from airrace.systems.control.setpoint import (
    ATTITUDE,
    IDLE,
    MOTORS,
    NO_SETPOINT,
    POSITION,
    RATES,
    VELOCITY,
    Setpoint,
)
from airrace.vehicle import GRAVITY, Vehicle

RESET = 31000  # MAV_CMD_USER_1: resets the simulation
ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
SET_MODE = mavlink.MAV_CMD_DO_SET_MODE  # set-points are followed in every mode
SETPOINTS = ("SET_ATTITUDE_TARGET", "SET_POSITION_TARGET_LOCAL_NED", "SET_ACTUATOR_CONTROL_TARGET")
# Of SET_ATTITUDE_TARGET's type_mask.
_BODY_RATES, _RATES_IN_RAD, _THRUST_VECTOR, _IGNORE_THRUST, _IGNORE_ATTITUDE = 7, 16, 32, 64, 128
_NO_ATTITUDE = _BODY_RATES | _IGNORE_THRUST | _IGNORE_ATTITUDE
# Of SET_POSITION_TARGET_LOCAL_NED's.
_FORCE, _IGNORE_YAW, _IGNORE_YAW_RATE = 512, 1024, 2048
_UNITED = 1e-3  # m; a quaternion shorter than this has no direction


class RefusedError(ValueError):
    """A command that cannot be obeyed: its words say why."""


class Airframe(NamedTuple):
    """What set-points depend on of the drone."""

    mass: float  # (kg)
    most: float  # thrust of all rotors (N)
    rotors: np.ndarray  # the rotor of each motor on the wire, (4,)


class Situation(NamedTuple):
    """What a set-point that comes is understood by."""

    airframe: Airframe
    origin: np.ndarray  # of LOCAL_NED, in the world (m), (3,)
    position: np.ndarray  # of the drone, in the world (m), (3,)
    yaw: float  # of the drone, from the world's x axis (rad)
    last: Setpoint  # in force


def make_airframe(vehicle: Vehicle, dialect: Dialect) -> Airframe:
    """Returns what set-points depend on of a vehicle of four rotors."""
    places = np.array([rotor.position[:2] for rotor in vehicle.rotors])
    corners = np.array(dialect.motors)
    orders = map(list, itertools.permutations(range(len(places)), len(corners)))
    rotors = max(orders, key=lambda order: float(np.sum(places[order] * corners)))
    return Airframe(vehicle.mass, float(vehicle.max_thrusts.sum()), np.array(rotors))


def setpoint_of(message: Any, dialect: Dialect, situation: Situation) -> Setpoint:
    """Returns the set-point of a message, with neither time nor armed.

    Args: message: a MAVLink message, one of SETPOINTS.

    Raises RefusedError if it cannot be obeyed.
    """
    kind = message.get_type()
    if kind == "SET_ATTITUDE_TARGET":
        wanted = _attitude(message, dialect, situation)
        is_still = situation.last.kind == IDLE and wanted.thrust == 0.0
        return NO_SETPOINT if is_still else wanted
    if kind == "SET_POSITION_TARGET_LOCAL_NED":
        return _motion(message, dialect, situation)
    motors = np.zeros(len(situation.airframe.rotors))
    motors[situation.airframe.rotors] = np.clip(_finite(message.controls[:4]), 0.0, 1.0)
    return NO_SETPOINT._replace(kind=MOTORS, motors=motors)


def _attitude(message, dialect, situation):
    mask = message.type_mask
    if mask & _THRUST_VECTOR:
        raise RefusedError("a thrust with a direction (bit 32 of type_mask) is not followed")
    if mask & _NO_ATTITUDE == _NO_ATTITUDE:
        raise RefusedError(f"type_mask {mask} of an attitude asks for nothing")
    thrust = _thrust(message, dialect, situation)
    wire = (message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate)
    given = [not mask & bit for bit in (1, 2, 4)]
    rates = _finite([rate if is_given else 0.0 for rate, is_given in zip(wire, given)])
    gains = dialect.rate_gains if mask & _RATES_IN_RAD else _stick_gains(rates, dialect)
    rates = flipped(gains * rates)
    if mask & _IGNORE_ATTITUDE:
        return NO_SETPOINT._replace(kind=RATES, thrust=thrust, rates=rates)
    q = _finite(message.q)
    length = float(np.linalg.norm(q))
    if length < _UNITED:
        raise RefusedError("the quaternion of an attitude is zero")
    quaternion = flipped_quaternion(dialect.setpoint_quaternion * q / length)
    return NO_SETPOINT._replace(
        kind=ATTITUDE, thrust=thrust, quaternion=quaternion, rates=rates,
        has_yaw=float(given != [False, False, True]),
    )  # fmt: skip


def _stick_gains(rates, dialect):
    """Returns what each body rate is multiplied by, which grows with it as a stick's does."""
    fullness = np.minimum(np.abs(rates), math.pi) / math.pi
    return dialect.stick_gains / (1.0 - np.array(dialect.stick_growth) * fullness)


def _thrust(message, dialect, situation):
    """Returns the thrust of SET_ATTITUDE_TARGET as a share of all that the rotors have."""
    frame, last = situation.airframe, situation.last
    weight = frame.mass * GRAVITY
    if message.type_mask & _IGNORE_THRUST:
        return last.thrust if last.kind in (RATES, ATTITUDE) else weight / frame.most
    thrust = min(max(_finite([message.thrust])[0], 0.0), 1.0)
    if dialect.thrust is not None:
        thrust = frame.mass * float(np.interp(thrust, *zip(*dialect.thrust))) / frame.most
    return min(thrust, 1.0)


def _motion(message, dialect, situation):
    mask, last = message.type_mask, situation.last
    frame = dialect.frames.get(message.coordinate_frame, dialect.other_frame)
    if frame is None:
        raise RefusedError(
            f"coordinate_frame {message.coordinate_frame} is not followed: take one of "
            f"{', '.join(map(str, dialect.frames))}"
        )
    place, has_place = _asked(mask, (message.x, message.y, message.z))
    speed, has_speed = _asked(mask >> 3, (message.vx, message.vy, message.vz))
    push, has_push = _asked(mask >> 6, (message.afx, message.afy, message.afz))
    has_yaw, has_rate = not mask & _IGNORE_YAW, not mask & _IGNORE_YAW_RATE
    if np.any(has_place | has_speed | has_push):
        if frame.heading and any(has[0] != has[1] for has in (has_place, has_speed, has_push)):
            raise RefusedError("x and y of a frame that follows the nose go together")
        yaw = situation.yaw if frame.heading else 0.0
        begin = situation.position if frame.offset else situation.origin
        push /= situation.airframe.mass if mask & _FORCE else 1.0
        speed[has_place] *= dialect.velocity_to_position
        wanted = NO_SETPOINT._replace(
            kind=POSITION if np.any(has_place) else VELOCITY,
            position=begin + _turned(yaw, place),
            velocity=_turned(yaw, speed),
            acceleration=_turned(yaw, push),
            has_position=has_place.astype(float),
            has_velocity=1.0 - (has_push & ~has_place & ~has_speed),
        )
    elif not (has_yaw or has_rate):
        raise RefusedError(f"type_mask {mask} of a position asks for nothing")
    else:
        wanted = last if last.kind in (POSITION, VELOCITY) else NO_SETPOINT._replace(kind=VELOCITY)
    if has_yaw:
        return wanted._replace(yaw=-_finite([message.yaw])[0], has_yaw=1.0, yaw_rate=0.0)
    if has_rate:
        return wanted._replace(has_yaw=0.0, yaw_rate=-_finite([message.yaw_rate])[0])
    if last.kind in (POSITION, VELOCITY):
        return wanted._replace(yaw=last.yaw, has_yaw=last.has_yaw)
    return wanted


def _asked(mask, numbers):
    """Returns three numbers, zeros where the mask says to ignore them, and where it does not."""
    asked = np.array([not mask & bit for bit in (1, 2, 4)])
    return _finite([number if is_asked else 0.0 for number, is_asked in zip(numbers, asked)]), asked


def _turned(yaw, v):
    """Returns a vector of the wire in the world's axes; yaw: of its x axis there (rad)."""
    x, y, z = flipped(v)
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([c * x - s * y, s * x + c * y, z])


def _finite(numbers: Iterable[float]) -> np.ndarray:
    values = [float(number) for number in numbers]
    if not all(map(math.isfinite, values)):
        raise RefusedError("a number is not finite")
    return np.array(values)
