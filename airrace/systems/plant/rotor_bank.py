"""Rotors between the commanded speeds and their thrusts."""

import functools
from collections.abc import Callable, Iterable

import numpy as np
from pydrake.systems.framework import Context

from airrace.common.jit import compiled
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_vector
from airrace.systems.seed import declare_seed
from airrace.vehicle import Vehicle
from airrace.vehicle.rotors import RotorDynamics, as_rotor_status, make_rotor_dynamics, next_speed


class RotorBank(LeafSystem):
    """All rotors of a vehicle: speed limits, first-order lag, thrust c_f w^2.

    .. pydrake_system::

        name: RotorBank
        input_ports:
        - rotor_speed_command
        - seed (only if rotors are drawn)
        output_ports:
        - rotor_speeds
        - rotor_status
        - thrusts

    Vectors have one element a rotor, in the order of the vehicle's rotor table:
    speeds in rad/s, thrusts in N. The lag is integrated exactly over the period. A
    command that is not finite counts as zero, and so does any to a rotor that has
    failed: it spins down.

    ``rotor_status`` is a vehicle.RotorStatus (1 + 2n), as the motor controllers report
    it. Only they know which commands arrived: over a link, not all do. ``seed``: see SeedSource.
    """

    def __init__(
        self,
        *,
        vehicle: Vehicle,
        period: float,
        failures: Iterable[tuple[int, float]] = (),
        drawn: Callable[[int], Vehicle] | None = None,
    ):
        """Constructs the bank, its rotors at rest.

        Args:
            vehicle: the rotor table.
            period: of the update (s). Speeds and thrusts are those of its end, and hold.
            failures: pairs of a rotor's index, from 0, and since when it has
                failed (s).
            drawn: from a seed to the vehicle as it really is, and then there is a port for the
                seed; by default, it is as it is.
        """
        LeafSystem.__init__(self)
        n = len(vehicle.rotors)
        self._failed = np.full(n, np.inf)
        for rotor, time in failures:
            self._failed[rotor] = min(time, self._failed[rotor])
        self._period = period
        self._command = self.DeclareVectorInputPort("rotor_speed_command", n)
        self._rotors = self._make_rotors(vehicle, drawn)
        # The thrusts are a state, too, so that the plant never has to call Python.
        self._speeds = self.DeclareDiscreteState(n)
        self._thrusts = self.DeclareDiscreteState(n)
        self._status = self.DeclareDiscreteState(1 + 2 * n)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update_speeds)
        self.DeclareStateOutputPort("rotor_speeds", self._speeds)
        self.DeclareStateOutputPort("rotor_status", self._status)
        self.DeclareStateOutputPort("thrusts", self._thrusts)

    def _make_rotors(
        self, vehicle: Vehicle, drawn: Callable[[int], Vehicle] | None
    ) -> Callable[[Context], tuple]:
        """Returns a function of the Context, to the parts of its RotorDynamics."""
        if drawn is None:
            rotors = tuple(make_rotor_dynamics(vehicle, self._period))
            return lambda context: rotors
        period, seed = self._period, declare_seed(self, 0)

        @functools.lru_cache(maxsize=4)
        def rotors_of(seed):
            return tuple(make_rotor_dynamics(drawn(seed), period))

        return lambda context: rotors_of(seed(context))

    def set_speeds(self, context: Context, speeds: np.ndarray) -> None:
        """Makes the rotors turn with some speeds (rad/s), (n,)."""
        rotors = RotorDynamics(*self._rotors(context))
        context.SetDiscreteState(self._speeds, speeds)
        context.SetDiscreteState(self._thrusts, rotors.thrust_coefficients * np.square(speeds))
        context.SetDiscreteState(self._status, [context.get_time(), *speeds, *speeds])

    def _update_speeds(self, context, discrete_state):
        _update(
            discrete_state.get_mutable_value(self._speeds),
            discrete_state.get_mutable_value(self._thrusts),
            discrete_state.get_mutable_value(self._status),
            read_vector(self._command, context),
            self._failed,
            self._rotors(context),
            context.get_time(),
            self._period,
        )


@compiled
def _update(speeds, thrusts, status, command, failed, rotors, now, period):
    """Advances speeds (rad/s), thrusts (N), both (n,), and the status, (1 + 2n,), by a period.

    Args:
        command: (rad/s), (n,).
        failed: since when each rotor has failed (s), (n,).
        rotors: their RotorDynamics, as a tuple.
        now, period: (s).
    """
    rotors, measured = RotorDynamics(*rotors), as_rotor_status(status)
    status[0] = now + period
    for i in range(len(speeds)):
        limit, share = rotors.max_speeds[i], rotors.step_share
        obeyed = command[i] if now < failed[i] else 0.0
        speeds[i] = measured.speeds[i] = next_speed(speeds[i], obeyed, limit, share)
        measured.expected[i] = next_speed(measured.expected[i], command[i], limit, share)
        thrusts[i] = rotors.thrust_coefficients[i] * speeds[i] * speeds[i]
