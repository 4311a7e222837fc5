"""Control of velocity and position: from a set-point to thrust and attitude."""

import math
from typing import NamedTuple

import numpy as np

from airrace.common.packing import Packing
from airrace.math.quaternion import reference_yaw
from airrace.math.vec3 import cross, dot
from airrace.systems.control.setpoint import POSITION, SETPOINT_SIZE, VELOCITY, as_setpoint
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_vector
from airrace.vehicle import GRAVITY, Vehicle
from airrace.vehicle.state import STATE_SIZE, as_state

_POSITION_GAIN, _VELOCITY_GAIN = 1.5, 3.0  # 1/s: both loops of a double integrator, damped by 0.7
_FASTEST = 8.0  # m/s, towards a position
_LEVEL_LIMIT, _UP_LIMIT, _DOWN_LIMIT = 8.0, 12.0, 5.0  # m/s^2


class AttitudeCommand(NamedTuple):
    """What the velocity controller asks of the attitude controller."""

    thrust: float  #: of all rotors (N)
    quaternion: np.ndarray  #: of R_WB, (4,)
    yaw_rate: float  #: about the vertical (rad/s)


_PACKING = Packing(AttitudeCommand, quaternion=4)
as_attitude_command, attitude_command_vector = _PACKING.parts, _PACKING.vector
ATTITUDE_COMMAND_SIZE = _PACKING.size


class VelocityController(LeafSystem):
    """Turns set-points of velocity and position into thrust and attitude.

    .. pydrake_system::

        name: VelocityController
        input_ports:
        - watched_setpoint
        - filtered_estimate
        output_ports:
        - attitude_command

    ``watched_setpoint`` is a Setpoint (33), ``filtered_estimate`` a vehicle.State (14).
    ``attitude_command`` is an AttitudeCommand (6); zeros for set-points of other kinds.

    The wanted acceleration is a_d + k_v (v_d - v), where v_d also leads to the position,
    v_d + k_p (p_d - p), and is limited; along axes without a position or a velocity, their terms
    are left out. Thrust and attitude follow as for any multirotor: the z
    axis of the body points along a - g, its x axis to the yaw (Mellinger and Kumar, "Minimum snap
    trajectory generation and control for quadrotors", ICRA 2011, section IV).
    """

    def __init__(self, *, vehicle: Vehicle):
        """Args: vehicle: its mass and rotors."""
        LeafSystem.__init__(self)
        self._mass, self._most = vehicle.mass, float(vehicle.max_thrusts.sum())
        self._setpoint = self.DeclareVectorInputPort("watched_setpoint", SETPOINT_SIZE)
        self._estimate = self.DeclareVectorInputPort("filtered_estimate", STATE_SIZE)
        self.DeclareVectorOutputPort("attitude_command", ATTITUDE_COMMAND_SIZE, self._calc_attitude)

    def _calc_attitude(self, context, output):
        setpoint = as_setpoint(read_vector(self._setpoint, context))
        if setpoint.kind not in (VELOCITY, POSITION):
            output.SetZero()
            return
        state = as_state(read_vector(self._estimate, context))
        velocity = np.array(setpoint.velocity)
        if setpoint.kind == POSITION:
            towards = _POSITION_GAIN * setpoint.has_position * (setpoint.position - state.position)
            speed = math.sqrt(dot(towards, towards))
            velocity += towards * min(1.0, _FASTEST / max(speed, 1e-9))
        # Without a yaw to have, the drone looks where it does.
        yaw = setpoint.yaw if setpoint.has_yaw else reference_yaw(state.quaternion)
        rate = 0.0 if setpoint.has_yaw else setpoint.yaw_rate
        a = _VELOCITY_GAIN * setpoint.has_velocity * (velocity - state.velocity)
        a += setpoint.acceleration
        level = math.hypot(a[0], a[1])
        a[:2] *= min(1.0, _LEVEL_LIMIT / max(level, 1e-9))
        a[2] = min(max(a[2], -_DOWN_LIMIT), _UP_LIMIT)
        force, quaternion = _attitude(a, float(yaw))
        thrust = min(self._mass * force, self._most)
        output.SetFromVector(attitude_command_vector(AttitudeCommand(thrust, quaternion, rate)))


def _attitude(a, yaw):
    """Returns specific force (m/s^2) and quaternion for an acceleration (m/s^2) and a yaw (rad)."""
    force = a + np.array((0.0, 0.0, GRAVITY))
    length = math.sqrt(dot(force, force))
    z = force / length
    y = cross(z, np.array((math.cos(yaw), math.sin(yaw), 0.0)))
    y /= math.sqrt(dot(y, y))
    x = cross(y, z)
    # The quaternion of the matrix with these columns, whose w is positive below 180 degrees.
    w = 0.5 * math.sqrt(max(1.0 + x[0] + y[1] + z[2], 1e-12))
    vector = np.array((y[2] - z[1], z[0] - x[2], x[1] - y[0])) / (4.0 * w)
    return length, np.array((w, *vector))
