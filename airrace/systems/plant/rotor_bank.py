"""Rotors between the commanded speeds and their thrusts."""

import numpy as np
from pydrake.systems.framework import LeafSystem

from airrace.common.jit import compilable, compiled
from airrace.systems.ports import read_vector
from airrace.vehicle import Vehicle


class RotorBank(LeafSystem):
    """All rotors of a vehicle: speed limits, first-order lag, thrust c_f w^2.

    .. pydrake_system::

        name: RotorBank
        input_ports:
        - rotor_speed_command
        output_ports:
        - rotor_speeds
        - rotor_status
        - thrusts

    Vectors have one element a rotor, in the order of the vehicle's rotor table:
    speeds in rad/s, thrusts in N. The lag is integrated exactly over the period. A
    command that is not finite counts as zero, and so does any to a rotor that has
    failed: it spins down.

    ``rotor_speeds`` is also what the motor controllers report. ``rotor_status``
    says more: the time (s), the speeds, and those that the motor controllers expect
    of rotors that work, after all the commands that reached them, (1 + 2n,). Only
    they know those: over a link, not every command of the autonomy arrives.
    """

    def __init__(self, *, vehicle: Vehicle, period: float, failures=()):
        """Constructs the bank, its rotors at rest.

        Args:
            vehicle: the rotor table.
            period: of the update (s). Speeds and thrusts are those of its end, and hold.
            failures: pairs of a rotor's index, from 0, and since when it has
                failed (s).
        """
        LeafSystem.__init__(self)
        n = len(vehicle.rotors)
        self._c_f = vehicle.thrust_coefficients
        failed = np.full(n, np.inf)
        for rotor, time in failures:
            failed[rotor] = min(time, failed[rotor])
        self._table = np.array([self._c_f, vehicle.max_speeds, failed])
        self._period = period
        self._blend = float(1.0 - np.exp(-period / vehicle.rotor_lag))
        self._command = self.DeclareVectorInputPort("rotor_speed_command", n)
        # The thrusts are a state, too, so that no call of Python stands in the plant's way.
        self._speeds = self.DeclareDiscreteState(n)
        self._thrusts = self.DeclareDiscreteState(n)
        self._report = self.DeclareDiscreteState(1 + 2 * n)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update_speeds)
        self.DeclareStateOutputPort("rotor_speeds", self._speeds)
        self.DeclareStateOutputPort("rotor_status", self._report)
        self.DeclareStateOutputPort("thrusts", self._thrusts)

    def set_speeds(self, context, speeds) -> None:
        """Makes the rotors turn with some speeds (rad/s), (n,)."""
        context.SetDiscreteState(self._speeds, speeds)
        context.SetDiscreteState(self._thrusts, self._c_f * np.square(speeds))
        context.SetDiscreteState(self._report, [context.get_time(), *speeds, *speeds])

    def _update_speeds(self, context, discrete_state):
        _update(
            discrete_state.get_mutable_value(self._speeds),
            discrete_state.get_mutable_value(self._thrusts),
            discrete_state.get_mutable_value(self._report),
            read_vector(self._command, context),
            self._table,
            context.get_time(),
            self._period,
            self._blend,
        )


@compiled
def _update(speeds, thrusts, report, command, table, now, period, blend):
    """Changes speeds (rad/s), thrusts (N), both (n,), and the report, (1 + 2n,), by a period.

    Args:
        command: (rad/s), (n,).
        table: of the rotors' coefficients and greatest speeds, see turn(), and since when
            each has failed (s), (3, n): one array, as each costs time to hand over.
        now, period: (s).
        blend: see turn().
    """
    n, (c_f, max_speeds, failed) = len(speeds), table
    report[0] = now + period
    for i in range(n):
        report[1 + n + i] = _turned(report[1 + n + i], command[i], max_speeds[i], blend)
        followed = command[i] if now < failed[i] else 0.0
        report[1 + i] = speeds[i] = _turned(speeds[i], followed, max_speeds[i], blend)
        thrusts[i] = c_f[i] * speeds[i] * speeds[i]


@compilable
def turn(speeds, thrusts, command, max_speeds, blend, c_f):
    """Changes speeds by one period of the lag, and thrusts with them (N), all (n,)."""
    for i in range(len(speeds)):
        speeds[i] = _turned(speeds[i], command[i], max_speeds[i], blend)
        thrusts[i] = c_f[i] * speeds[i] * speeds[i]


@compilable
def _turned(speed, command, max_speed, blend):
    """Returns the speed of one rotor after a period of the lag (rad/s)."""
    wanted = min(command, max_speed) if command > 0.0 else 0.0  # NaN is not greater than zero
    return speed + blend * (wanted - speed)
