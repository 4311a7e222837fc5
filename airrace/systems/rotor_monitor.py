"""Notices rotors that have stopped."""

import math

import numpy as np
from pydrake.systems.framework import LeafSystem

from airrace.compiled import compiled
from airrace.vehicle import Vehicle

_SHARE = 0.8  # of the speed that it should have: a rotor below that does not follow
_LEAST = 0.2  # of the greatest speed: below, there is nothing to tell by
_WINDOW = 0.03  # s by which a command may be late
_PATIENCE = 0.006  # s of not following
_GAP = 0.05  # s without a look, after which the model begins anew
_GRACE = 1.0  # s from there on, in which somebody else may still command the rotors


class RotorMonitor(LeafSystem):
    """Compares the reported rotor speeds with those that were commanded.

    .. pydrake_system::

        name: RotorMonitor
        input_ports:
        - rotor_speed_command
        - rotor_speeds
        output_ports:
        - rotor_losses

    ``rotor_speed_command`` and ``rotor_speeds`` (rad/s) have one element a
    rotor; ``rotor_losses`` is the time at which each rotor was found to be lost
    (s), infinite for those that work.

    A model of each rotor, a first-order lag, follows the commands. A rotor is
    lost for good once its reported speed has for a few milliseconds been clearly
    below all that the model has had in the last 30 ms, within which a command
    should arrive. After a time without looks, as of an autonomy that has started
    again, it judges a second later: until its commands arrive, somebody else's count.
    """

    def __init__(self, *, vehicle: Vehicle, rate: float, link_delay: float = 0.0):
        """Constructs the monitor.

        Args:
            vehicle: the rotor table.
            rate: of the commands (Hz).
            link_delay: by which a command and its report may be late besides (s).
        """
        LeafSystem.__init__(self)
        n = len(vehicle.rotors)
        self._period = 1.0 / rate
        self._blend = 1.0 - math.exp(-self._period / vehicle.rotor_lag)
        self._least = _LEAST * vehicle.max_speeds
        self._command = self.DeclareVectorInputPort("rotor_speed_command", n)
        self._speeds = self.DeclareVectorInputPort("rotor_speeds", n)
        # The model's speeds, newest first, for how long a rotor has not followed (s), from
        # when on it is judged (s), and when the last look was (s).
        depth = math.ceil((_WINDOW + link_delay) * rate) + 1
        self._memory = self.DeclareDiscreteState((depth + 1) * n + 2)
        self._losses = self.DeclareDiscreteState(np.full(n, np.inf))
        self.DeclarePeriodicDiscreteUpdateEvent(self._period, 0.0, self._Compare)
        self.DeclareStateOutputPort("rotor_losses", self._losses)

    def _Compare(self, context, discrete_state):
        _compare(discrete_state.get_mutable_value(self._memory),
                 discrete_state.get_mutable_value(self._losses),
                 self._speeds.Eval(context), self._command.Eval(context), self._least,
                 self._blend, self._period, context.get_time())


@compiled
def _compare(memory, losses, speeds, command, least, blend, period, now):
    """Compares, changes the memory, and notes which rotors are lost since now.

    Args:
        memory: see RotorMonitor. losses: of the rotors (s), (n,).
        speeds, command: of the rotors (rad/s), (n,).
        least: model speeds up to which there is nothing to tell by (rad/s), (n,).
        blend: share of a step that a rotor makes in a period.
        period: (s). now: (s).
    """
    n = len(speeds)
    model, waited = memory[:-n - 2].reshape(-1, n), memory[-n - 2:-2]
    if now - memory[-1] > _GAP:
        # Whoever was not there does not know what was commanded.
        model[:], waited[:] = speeds, 0.0
        memory[-2] = now + _GRACE
    memory[-1] = now
    for i in range(n):
        due, modelled = model[:, i].min(), model[0, i]
        for k in range(len(model) - 1, 0, -1):
            model[k, i] = model[k - 1, i]
        model[0, i] = modelled + blend * (command[i] - modelled)
        # Written such that a speed that is not a number is too low.
        follows = speeds[i] >= _SHARE * due
        waited[i] = waited[i] + period if due > least[i] and not follows else 0.0
        if waited[i] > _PATIENCE and now >= memory[-2]:
            losses[i] = min(losses[i], now)
