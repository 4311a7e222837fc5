"""Notices rotors that have stopped."""

import math

import numpy as np
from pydrake.systems.framework import LeafSystem

from airrace.vehicle import Vehicle

_SHARE = 0.8  # of the speed that it should have: a rotor below that does not follow
_LEAST = 0.2  # of the greatest speed: below, there is nothing to tell by
_WINDOW = 0.03  # s by which a command may be late
_PATIENCE = 0.006  # s of not following


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

    def __init__(self, *, vehicle: Vehicle, rate: float):
        """Constructs the monitor.

        Args:
            vehicle: the rotor table.
            rate: of the commands (Hz).
        """
        LeafSystem.__init__(self)
        n = len(vehicle.rotors)
        self._period = 1.0 / rate
        self._blend = 1.0 - math.exp(-self._period / vehicle.rotor_lag)
        self._least = (_LEAST * vehicle.max_speeds).tolist()
        self._command = self.DeclareVectorInputPort("rotor_speed_command", n)
        self._speeds = self.DeclareVectorInputPort("rotor_speeds", n)
        # The model's speeds, newest first, and for how long a rotor has not followed (s).
        self._depth = math.ceil(_WINDOW * rate) + 1
        self._model = self.DeclareDiscreteState((self._depth + 1) * n)
        losses = self.DeclareDiscreteState(np.full(n, np.inf))
        self._losses = losses
        self.DeclarePeriodicDiscreteUpdateEvent(self._period, 0.0, self._Compare)
        self.DeclareStateOutputPort("rotor_losses", losses)

    def _Compare(self, context, discrete_state):
        n = self._speeds.size()
        memory = context.get_discrete_state(self._model).value()
        speeds = self._speeds.Eval(context).tolist()
        newest = memory[:n].tolist()
        # Written such that a speed that is not a number is too low. Who follows the newest
        # of the model's speeds follows the least.
        if all(speed >= _SHARE * model for speed, model in zip(speeds, newest)):
            waited = n * [0.0]
        else:
            due = memory[:-n].reshape(-1, n).min(axis=0).tolist()
            waited = [
                since + self._period if model > least and not speed >= _SHARE * model else 0.0
                for since, model, least, speed in zip(
                    memory[-n:].tolist(), due, self._least, speeds)
            ]
        if max(waited) > _PATIENCE:
            losses = context.get_discrete_state(self._losses).value()
            lost = np.where(np.array(waited) > _PATIENCE, context.get_time(), np.inf)
            discrete_state.set_value(self._losses, np.minimum(losses, lost))
        after = np.empty_like(memory)
        after[:n] = [
            model + self._blend * (command - model)
            for model, command in zip(newest, self._command.Eval(context).tolist())
        ]
        after[n:-n] = memory[:-2 * n]
        after[-n:] = waited
        discrete_state.set_value(self._model, after)
