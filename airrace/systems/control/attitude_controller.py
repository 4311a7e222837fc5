"""Control of attitude: from a set-point to total thrust and body rates."""

import numpy as np

from airrace.math.quaternion import (
    exp_quaternion,
    quaternion_product,
    reference_yaw,
    rotation_between,
    rotation_matrix,
)
from airrace.systems.control.setpoint import (
    ATTITUDE,
    POSITION,
    RATES,
    SETPOINT_SIZE,
    VELOCITY,
    as_setpoint,
)
from airrace.systems.control.velocity_controller import ATTITUDE_COMMAND_SIZE, as_attitude_command
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_vector
from airrace.vehicle import Vehicle
from airrace.vehicle.state import STATE_SIZE, as_state

_GAINS = np.array((10.0, 10.0, 4.0))  # 1/s, a fifth of the rate controller's
MOST_RATES = np.array((10.0, 10.0, 6.0))  # rad/s, that are handed on


class AttitudeController(LeafSystem):
    """Turns set-points of attitude into thrust and rates, and hands those of rates on.

    .. pydrake_system::

        name: AttitudeController
        input_ports:
        - watched_setpoint
        - attitude_command
        - filtered_estimate
        output_ports:
        - rate_command

    ``watched_setpoint`` is a Setpoint (33), ``attitude_command`` an AttitudeCommand (6),
    ``filtered_estimate`` a vehicle.State (14), and ``rate_command`` what RateController
    takes: [f, w_x, w_y, w_z] (N, rad/s), (4,), zeros for other set-points.

    The rates are proportional to the rotation vector from the attitude to the one wanted, in B,
    and those of the set-point on top. One of an ATTITUDE without a yaw has that of the drone.
    """

    def __init__(self, *, vehicle: Vehicle):
        """Args: vehicle: its rotors."""
        LeafSystem.__init__(self)
        self._most = float(vehicle.max_thrusts.sum())
        self._setpoint = self.DeclareVectorInputPort("watched_setpoint", SETPOINT_SIZE)
        self._attitude = self.DeclareVectorInputPort("attitude_command", ATTITUDE_COMMAND_SIZE)
        self._estimate = self.DeclareVectorInputPort("filtered_estimate", STATE_SIZE)
        self.DeclareVectorOutputPort("rate_command", 4, self._calc_rates)

    def _calc_rates(self, context, output):
        setpoint = as_setpoint(read_vector(self._setpoint, context))
        command = output.get_mutable_value()
        command[:] = 0.0
        if setpoint.kind == RATES:
            command[0] = setpoint.thrust * self._most
            command[1:] = np.clip(setpoint.rates, -MOST_RATES, MOST_RATES)
        elif setpoint.kind in (ATTITUDE, VELOCITY, POSITION):
            thrust, quaternion, yaw_rate = setpoint.thrust * self._most, setpoint.quaternion, 0.0
            if setpoint.kind != ATTITUDE:
                thrust, quaternion, yaw_rate = as_attitude_command(
                    read_vector(self._attitude, context)
                )
            q = as_state(read_vector(self._estimate, context)).quaternion
            if setpoint.kind == ATTITUDE and not setpoint.has_yaw:
                quaternion = _with_yaw_of(quaternion, q)
            rates = _GAINS * rotation_between(q, quaternion) + yaw_rate * rotation_matrix(q)[2]
            if setpoint.kind == ATTITUDE:
                rates = rates + setpoint.rates
            command[0], command[1:] = thrust, np.clip(rates, -MOST_RATES, MOST_RATES)


def _with_yaw_of(quaternion, q):
    """Returns an attitude that is turned about the vertical, so that its yaw is that of q."""
    turn = reference_yaw(q) - reference_yaw(quaternion)
    return quaternion_product(exp_quaternion(np.array((0.0, 0.0, turn))), quaternion)
