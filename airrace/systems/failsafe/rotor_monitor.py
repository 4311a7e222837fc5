"""Notices rotors that have stopped."""

from typing import TYPE_CHECKING

import numpy as np

from airrace.common.jit import compiled
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_vector
from airrace.vehicle import Vehicle, load_vehicle
from airrace.vehicle.rotors import as_rotor_status

if TYPE_CHECKING:
    from typing import Self

    from airrace.scenario import Scenario

_SHARE = 0.8  # of the speed that it should have: a rotor below that does not follow
_LEAST = 0.2  # of the greatest speed: below, there is nothing to tell by
_PATIENCE = 0.004 - 1e-9  # s of not following


class RotorMonitor(LeafSystem):
    """Compares the speeds that the motor controllers report with those that they expect.

    .. pydrake_system::

        name: RotorMonitor
        input_ports:
        - rotor_status
        output_ports:
        - rotor_losses

    ``rotor_status`` is a vehicle.RotorStatus (1 + 2n). ``rotor_losses`` is the time at
    which each rotor was found to be lost (s), infinite for those that work, (n,).

    A rotor is lost for good once all reports of some milliseconds say that it is
    clearly slower than it should be.
    """

    def __init__(self, *, vehicle: Vehicle, rate: float):
        """Constructs the monitor. Args: vehicle: the rotor table. rate: of comparing (Hz)."""
        LeafSystem.__init__(self)
        n = len(vehicle.rotors)
        self._least = _LEAST * vehicle.max_speeds
        self._report = self.DeclareVectorInputPort("rotor_status", 1 + 2 * n)
        # By the times of the reports (s), infinite for rotors that follow.
        self._slow_since = self.DeclareDiscreteState(np.full(n, np.inf))
        self._losses = self.DeclareDiscreteState(np.full(n, np.inf))
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / rate, 0.0, self._compare)
        self.DeclareStateOutputPort("rotor_losses", self._losses)

    @classmethod
    def from_scenario(cls, scenario: "Scenario") -> "Self":
        """Returns the monitor of a scenario."""
        return cls(vehicle=load_vehicle(scenario.drone)[0], rate=scenario.rotor_monitor.rate)

    def _compare(self, context, discrete_state):
        _compare(
            discrete_state.get_mutable_value(self._slow_since),
            discrete_state.get_mutable_value(self._losses),
            read_vector(self._report, context),
            self._least,
            context.get_time(),
        )


@compiled
def _compare(slow_since, losses, rotor_status, least, now):
    """Notes which rotors do not follow, and which are lost since now.

    Args:
        slow_since: see RotorMonitor (s), (n,); changed.
        losses: of the rotors (s), (n,); changed.
        rotor_status: vector of a RotorStatus, (1 + 2n,).
        least: expected speeds up to which there is nothing to tell by (rad/s), (n,).
        now: (s).
    """
    status = as_rotor_status(rotor_status)
    for i in range(len(losses)):
        expected = status.expected[i]
        # Written such that a speed that is not a number is too low.
        is_slow = expected > least[i] and not status.speeds[i] >= _SHARE * expected
        slow_since[i] = min(slow_since[i], status.time) if is_slow else np.inf
        if status.time - slow_since[i] >= _PATIENCE:
            losses[i] = min(losses[i], now)
