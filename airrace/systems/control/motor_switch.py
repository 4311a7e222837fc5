"""The last word on the motors: off, commanded one by one, or by the rate controller."""

import numpy as np

from airrace.systems.control.setpoint import IDLE, MOTORS, SETPOINT_SIZE, as_setpoint
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_vector
from airrace.vehicle import Vehicle


class MotorSwitch(LeafSystem):
    """Chooses what the rotors are told.

    .. pydrake_system::

        name: MotorSwitch
        input_ports:
        - watched_setpoint
        - controlled_speeds
        output_ports:
        - rotor_speed_command

    ``watched_setpoint`` is a Setpoint (33); ``controlled_speeds`` are RateController's commands and
    ``rotor_speed_command`` those in force, one speed a rotor (rad/s). They are zero while the
    drone is not armed or nothing is wanted of it, and those of the motors' shares of thrust,
    whose speeds go with the square root, if these are set one by one.
    """

    def __init__(self, *, vehicle: Vehicle):
        """Args: vehicle: its rotors, of which set-points have the first four."""
        LeafSystem.__init__(self)
        self._max_speeds = vehicle.max_speeds
        n = len(self._max_speeds)
        self._setpoint = self.DeclareVectorInputPort("watched_setpoint", SETPOINT_SIZE)
        self._speeds = self.DeclareVectorInputPort("controlled_speeds", n)
        self.DeclareVectorOutputPort("rotor_speed_command", n, self._calc_command)

    def _calc_command(self, context, output):
        setpoint = as_setpoint(read_vector(self._setpoint, context))
        command = output.get_mutable_value()
        if not setpoint.armed or setpoint.kind == IDLE:
            command[:] = 0.0
        elif setpoint.kind == MOTORS:
            command[:] = 0.0
            shares = np.clip(setpoint.motors, 0.0, 1.0)[: len(command)]
            command[: len(shares)] = np.sqrt(shares) * self._max_speeds[: len(shares)]
        else:
            command[:] = read_vector(self._speeds, context)
