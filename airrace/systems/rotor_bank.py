"""Rotors between the commanded speeds and their thrusts."""

import numpy as np
from pydrake.systems.framework import LeafSystem

from airrace.compiled import compiled
from airrace.vehicle import Vehicle


class RotorBank(LeafSystem):
    """All rotors of a vehicle: speed limits, first-order lag, thrust c_f w^2.

    .. pydrake_system::

        name: RotorBank
        input_ports:
        - rotor_speed_command
        output_ports:
        - rotor_speeds
        - thrusts

    All ports are vectors with one element a rotor, in the order of the
    vehicle's rotor table: speeds in rad/s, thrusts in N. ``rotor_speeds`` is
    also what the motor controllers report. The lag is integrated exactly over
    the period. A command that is not finite counts as zero, and so does any
    to a rotor that has failed: it spins down.
    """

    def __init__(self, *, vehicle: Vehicle, period: float, failures=()):
        """Constructs the bank, its rotors at rest.

        Args:
            vehicle: the rotor table.
            period: of the update (s); the plant's time step.
            failures: pairs of a rotor's index, from 0, and since when it has
                failed (s).
        """
        LeafSystem.__init__(self)
        n = len(vehicle.rotors)
        self._c_f, self._max_speeds = vehicle.thrust_coefficients, vehicle.max_speeds
        self._failures = tuple(failures)
        self._blend = float(1.0 - np.exp(-period / vehicle.rotor_lag))
        self._command = self.DeclareVectorInputPort("rotor_speed_command", n)
        # The thrusts are a state, too, so that no call of Python stands in the plant's way.
        self._speeds = self.DeclareDiscreteState(n)
        self._thrusts = self.DeclareDiscreteState(n)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._UpdateSpeeds)
        self.DeclareStateOutputPort("rotor_speeds", self._speeds)
        self.DeclareStateOutputPort("thrusts", self._thrusts)

    def SetSpeeds(self, context, speeds) -> None:
        """Makes the rotors turn with some speeds (rad/s), (n,)."""
        context.SetDiscreteState(self._speeds, speeds)
        context.SetDiscreteState(self._thrusts, self._c_f * np.square(speeds))

    def _UpdateSpeeds(self, context, discrete_state):
        command = self._command.Eval(context)
        for rotor, time in self._failures:
            if context.get_time() >= time:
                command[rotor] = 0.0
        turn(discrete_state.get_mutable_value(self._speeds),
             discrete_state.get_mutable_value(self._thrusts),
             command, self._max_speeds, self._blend, self._c_f)


@compiled
def turn(speeds, thrusts, command, max_speeds, blend, c_f):
    """Changes speeds by one period of the lag, and thrusts with them (N), all (n,)."""
    for i in range(len(speeds)):
        # NaN is not greater than zero.
        wanted = min(command[i], max_speeds[i]) if command[i] > 0.0 else 0.0
        speeds[i] += blend * (wanted - speeds[i])
        thrusts[i] = c_f[i] * speeds[i] * speeds[i]
