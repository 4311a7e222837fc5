"""Lets a plan wait for a drone that cannot follow."""

from typing import TYPE_CHECKING, Self

import numpy as np
from pydrake.common.value import Value

from airrace.systems.leaf_system import LeafSystem
from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.systems.planning.path_clock import (
    REGULAR,
    REGULAR_VECTOR,
    PathClock,
    as_clock,
    clock_vector,
)
from airrace.systems.ports import read_vector
from airrace.vehicle.state import STATE_SIZE, as_state

if TYPE_CHECKING:
    from airrace.scenario import Scenario

# m, off the reference: from the first on plans are slowed, from the second on as much as they may.
_FREE, _MOST = 0.15, 1.2
_SLOWEST = 0.7  # of the clock's rate, that is taken away at most: it never stands
_BANDWIDTH = 4.0  # rad/s, of the rate
_NOTHING = 1e-6  # a slowing that is none


class PathGovernor(LeafSystem):
    """Slows the clock of plans while the drone is far from its reference.

    .. pydrake_system::

        name: PathGovernor
        input_ports:
        - lap_plan
        - filtered_estimate
        output_ports:
        - path_clock

    ``lap_plan`` is a LapPlan or NO_PLAN, ``filtered_estimate`` a vehicle.State (14), ``path_clock``
    the vector of a PathClock (6).

    A plan at the limit of what the rotors can do cannot be caught up with: a drone that is pushed
    off it, or is weaker than its file says, stays behind for good, and the error of its position
    asks for forces that are not there. If the plan is flown slower, it takes less force: the
    accelerations go with the square of the rate. So the path stays what it was, and only the time
    along it changes: Dahl and Nielsen, "Torque-limited path following by on-line trajectory time
    scaling", IEEE Transactions on Robotics and Automation, 1990. There, the rate follows from the
    torques; here, from the error e of the position, which shows whatever the reason is:

        wanted slowing = 0.7 min(max((|e| - 0.15 m) / 1.05 m, 0), 1)

    The slowing follows the wanted one as a low-pass filter of third order, so that the reference's
    acceleration, jerk and snap are continuous, or held. A drone that follows within 0.15 m flies
    plans as they are, to the last bit.
    """

    def __init__(self, *, rate: float, waits: bool = True):
        """Args: rate: of updates (Hz). waits: whether it ever slows the clock."""
        LeafSystem.__init__(self)
        self._waits = waits
        self._plan = self.DeclareAbstractInputPort("lap_plan", Value[object](NO_PLAN))
        self._estimate = self.DeclareVectorInputPort("filtered_estimate", STATE_SIZE)
        clock = self.DeclareDiscreteState(REGULAR_VECTOR)
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / rate, 0.0, self._update)
        self.DeclareStateOutputPort("path_clock", clock)

    @classmethod
    def from_scenario(cls, scenario: "Scenario") -> Self:
        """Returns the governor of a scenario."""
        return cls(rate=scenario.controller.rate, waits=scenario.planner.waits)

    def _update(self, context, discrete_state):
        clock = as_clock(context.get_discrete_state(0).value())
        plan, now = self._plan.Eval(context), context.get_time()
        position = as_state(read_vector(self._estimate, context)).position
        error = 0.0
        if self._waits and plan is not NO_PLAN and np.isfinite(position).all():
            error = float(np.linalg.norm(clock.reference(plan, now)[:3] - position))
        after = _governed(clock, now, error)
        if after is not clock:
            discrete_state.get_mutable_value(0)[:] = clock_vector(after)


def _governed(clock: PathClock, now: float, error: float) -> PathClock:
    """Returns the clock from a time (s) on, with an error of the position (m)."""
    wanted = _SLOWEST * float(np.clip((error - _FREE) / (_MOST - _FREE), 0.0, 1.0))
    if clock.is_regular and wanted == 0.0:
        return clock
    now_clock, w = clock.after(now), _BANDWIDTH
    _, delay, slowing, rate, acceleration, _ = now_clock
    # The poles of the filter are three times -w.
    jerk = w**3 * (wanted - slowing) - 3.0 * w**2 * rate - 3.0 * w * acceleration
    if wanted == 0.0 and max(map(abs, (slowing, rate / w, acceleration / w**2))) < _NOTHING:
        return REGULAR._replace(time=now, delay=delay)
    return now_clock._replace(slowing_jerk=jerk)
