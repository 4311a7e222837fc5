"""Control of velocity and position: from a set-point to thrust and attitude."""

import math

import numpy as np

from airrace.math.quaternion import heading
from airrace.math.vec3 import cross, dot
from airrace.systems.control.setpoint import POSITION, SETPOINT_SIZE, VELOCITY, as_setpoint
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_vector
from airrace.vehicle import GRAVITY, Vehicle
from airrace.vehicle.state import STATE_SIZE, as_state

ATTITUDE_COMMAND_SIZE = 6
_POSITION_GAIN, _VELOCITY_GAIN = 1.5, 3.0  # 1/s: both loops of a double integrator, damped by 0.7
_FASTEST = 8.0  # m/s, towards a position
_LEVEL_LIMIT, _UP_LIMIT, _DOWN_LIMIT = 8.0, 12.0, 5.0  # m/s^2


class VelocityController(LeafSystem):
    """Turns set-points of velocity and position into thrust and attitude.

    .. pydrake_system::

        name: VelocityController
        input_ports:
        - watched_setpoint
        - filtered_estimate
        output_ports:
        - attitude_command

    ``watched_setpoint`` is a Setpoint (24), ``filtered_estimate`` a vehicle.State (14).
    ``attitude_command``: total thrust (N), the quaternion of R_WB, and a rate about the vertical
    (rad/s), (6,); zeros for set-points of other kinds.

    The wanted acceleration is k_v (v_d - v), where v_d also leads to the position,
    v_d + k_p (p_d - p), and is limited. Thrust and attitude follow as for any multirotor: the z
    axis of the body points along a - g, its x axis to the yaw (Mellinger and Kumar, "Minimum snap
    trajectory generation and control for quadrotors", ICRA 2011, section IV).
    """

    def __init__(self, *, vehicle: Vehicle):
        """Args: vehicle: its mass and rotors."""
        LeafSystem.__init__(self)
        self._limits = vehicle.mass, float(vehicle.max_thrusts.sum())
        self._setpoint = self.DeclareVectorInputPort("watched_setpoint", SETPOINT_SIZE)
        self._estimate = self.DeclareVectorInputPort("filtered_estimate", STATE_SIZE)
        self.DeclareVectorOutputPort("attitude_command", ATTITUDE_COMMAND_SIZE, self._calc_attitude)

    def _calc_attitude(self, context, output):
        setpoint = as_setpoint(read_vector(self._setpoint, context))
        command = output.get_mutable_value()
        if setpoint.kind not in (VELOCITY, POSITION):
            command[:] = 0.0
            return
        state = as_state(read_vector(self._estimate, context))
        velocity = np.array(setpoint.velocity)
        if setpoint.kind == POSITION:
            velocity += _towards(setpoint.position, np.array(state.position))
        # Without a yaw to have, the drone looks where it does.
        yaw = setpoint.yaw if setpoint.has_yaw else heading(state.quaternion)
        rate = 0.0 if setpoint.has_yaw else setpoint.yaw_rate
        a = _acceleration(velocity, np.array(state.velocity))
        _set_attitude(command, a, float(yaw), float(rate), self._limits)


def _towards(wanted, position):
    """Returns the velocity that leads to a position (m/s), (3,)."""
    v = _POSITION_GAIN * (wanted - position)
    speed = math.sqrt(dot(v, v))
    return v * min(1.0, _FASTEST / max(speed, 1e-9))


def _acceleration(wanted, velocity):
    """Returns the acceleration for velocities in the world, limited (m/s^2), (3,)."""
    a = _VELOCITY_GAIN * (wanted - velocity)
    level = math.hypot(a[0], a[1])
    a[:2] *= min(1.0, _LEVEL_LIMIT / max(level, 1e-9))
    a[2] = min(max(a[2], -_DOWN_LIMIT), _UP_LIMIT)
    return a


def _set_attitude(command, a, yaw, yaw_rate, limits):
    """Writes thrust (N), quaternion and yaw rate for an acceleration a (m/s^2) and a yaw (rad)."""
    mass, most = limits
    force = a + np.array((0.0, 0.0, GRAVITY))
    length = math.sqrt(dot(force, force))
    z = force / length
    y = cross(z, np.array((math.cos(yaw), math.sin(yaw), 0.0)))
    y /= math.sqrt(dot(y, y))
    x = cross(y, z)
    command[0] = min(mass * length, most)
    # The quaternion of the matrix with these columns, whose w is positive below 180 degrees.
    w = 0.5 * math.sqrt(max(1.0 + x[0] + y[1] + z[2], 1e-12))
    command[1] = w
    command[2] = (y[2] - z[1]) / (4.0 * w)
    command[3] = (z[0] - x[2]) / (4.0 * w)
    command[4] = (x[1] - y[0]) / (4.0 * w)
    command[5] = yaw_rate
