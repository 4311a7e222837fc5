"""Rotors between the commanded speeds and their thrusts."""

import numpy as np
from pydrake.systems.framework import LeafSystem

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
        self._c_f = vehicle.thrust_coefficients.tolist()
        self._max_speeds = vehicle.max_speeds.tolist()
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
        context.SetDiscreteState(self._thrusts, self._Thrusts(speeds))

    def _Thrusts(self, speeds) -> np.ndarray:
        return np.array([c * w * w for c, w in zip(self._c_f, speeds)])

    def _UpdateSpeeds(self, context, discrete_state):
        # Plain numbers: arrays this small cost more than they spare. NaN is not
        # greater than zero.
        command = [
            min(speed, limit) if speed > 0.0 else 0.0
            for speed, limit in zip(self._command.Eval(context).tolist(), self._max_speeds)
        ]
        for rotor, time in self._failures:
            if context.get_time() >= time:
                command[rotor] = 0.0
        blend = self._blend
        speeds = [
            speed + blend * (wanted - speed)
            for speed, wanted in zip(
                context.get_discrete_state(self._speeds).value().tolist(), command)
        ]
        discrete_state.set_value(self._speeds, np.array(speeds))
        discrete_state.set_value(self._thrusts, self._Thrusts(speeds))
