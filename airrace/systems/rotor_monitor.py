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
    should arrive.
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
        # The model's speeds, newest first, and for how long a rotor has not followed (s).
        self._depth = math.ceil((_WINDOW + link_delay) * rate) + 1
        self._model = self.DeclareDiscreteState((self._depth + 1) * n)
        self._looked = self.DeclareDiscreteState(1)  # when it last did (s)
        losses = self.DeclareDiscreteState(np.full(n, np.inf))
        self._losses = losses
        self.DeclarePeriodicDiscreteUpdateEvent(self._period, 0.0, self._Compare)
        self.DeclareStateOutputPort("rotor_losses", losses)

    def _Compare(self, context, discrete_state):
        memory = context.get_discrete_state(self._model).value()
        speeds, now = self._speeds.Eval(context), context.get_time()
        if now - context.get_discrete_state(self._looked).value()[0] > _GAP:
            # Whoever was not there does not know what was commanded.
            memory = np.concatenate([np.tile(speeds, self._depth), np.zeros(len(speeds))])
        discrete_state.set_value(self._looked, [now])
        after, lost = _compared(
            memory, speeds, self._command.Eval(context), self._least, self._blend, self._period)
        discrete_state.set_value(self._model, after)
        if lost.any():
            losses = context.get_discrete_state(self._losses).value()
            discrete_state.set_value(
                self._losses, np.minimum(losses, np.where(lost, context.get_time(), np.inf)))


@compiled
def _compared(memory, speeds, command, least, blend, period):
    """Returns the memory after a comparison, and which rotors are lost, (n,).

    Args:
        memory: the model's speeds, newest first, and how long each rotor has not followed.
        speeds, command: of the rotors (rad/s), (n,).
        least: model speeds up to which there is nothing to tell by (rad/s), (n,).
        blend: share of a step that a rotor makes in a period.
        period: (s).
    """
    n = len(speeds)
    after = np.empty_like(memory)
    after[n:-n] = memory[:-2 * n]
    lost = np.zeros(n, np.bool_)
    for i in range(n):
        after[i] = memory[i] + blend * (command[i] - memory[i])
        due = memory[i:-n:n].min()
        # Written such that a speed that is not a number is too low.
        follows = speeds[i] >= _SHARE * due
        waited = memory[i - n] + period if due > least[i] and not follows else 0.0
        after[i - n], lost[i] = waited, waited > _PATIENCE
    return after, lost
