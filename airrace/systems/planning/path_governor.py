"""Lets a plan wait for a drone that cannot follow."""

import math
from typing import TYPE_CHECKING, Self

import numpy as np
from pydrake.common.value import Value

from airrace.common.jit import compiled
from airrace.math.vec3 import dot
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.systems.planning.path_clock import (
    REGULAR,
    REGULAR_VECTOR,
    PathClock,
    as_clock,
    clock_vector,
)
from airrace.systems.ports import read_or, read_vector
from airrace.vehicle import GRAVITY_W, Vehicle, load_vehicle
from airrace.vehicle.air import AIR_SIZE, STILL_VECTOR, as_air, drag_acceleration
from airrace.vehicle.state import STATE_SIZE, as_state

if TYPE_CHECKING:  # else an edit of it would have all machine code compiled anew
    from airrace.scenario import Scenario

# m, off the reference: from the first on plans are slowed, from the second on as much as they may.
_FREE, _MOST = 0.15, 1.2
_SLOWEST = 0.7  # of the clock's rate, that is taken away at most: it never stands
# rad/s, of the rate: for what comes, and for an error. Slowing takes force, too: where there is
# none left, a quick one would make the error grow.
_BANDWIDTH, _GENTLY = 8.0, 4.0
_NOTHING = 1e-6  # a slowing that is none
# s: how far ahead of the drone the plan's forces are compared with the rotors', and how often.
_AHEAD, _PERIOD = np.arange(0.1, 0.75, 0.1), 0.1
_RATES = np.linspace(1.0, 1.0 - _SLOWEST, 15)  # of the clock, tried in turn


class PathGovernor(LeafSystem):
    """Slows the clock of plans while the drone is far from its reference.

    .. pydrake_system::

        name: PathGovernor
        input_ports:
        - lap_plan
        - filtered_estimate
        - rotor_factors (may be left open: rotors are as in the drone's file)
        - air (may be left open: it is not known)
        output_ports:
        - path_clock

    ``lap_plan`` is a LapPlan or NO_PLAN, ``filtered_estimate`` a vehicle.State (14), ``path_clock``
    the vector of a PathClock (6); for the others see RotorLearner and AirLearner.

    A plan at the limit of what the rotors can do cannot be caught up with: a drone that is pushed
    off it, or is weaker than its file says, stays behind for good, and the error of its position
    asks for forces that are not there. If the plan is flown slower, it takes less force: the
    accelerations go with the square of the rate. So the path stays what it was, and only the time
    along it changes: Dahl and Nielsen, "Torque-limited path following by on-line trajectory time
    scaling", IEEE Transactions on Robotics and Automation, 1990. There, the rate follows from the
    torques. Here it is the quickest at which the rotors, as they are known by now, have the forces
    that the plan takes in the next 0.7 s through the air as it is known by now: both may be news to
    the plan. What is not known shows in the error e of the position:

        wanted slowing = 0.7 min(max((|e| - 0.15 m) / 1.05 m, 0), 1)

    The greater of both is wanted. The slowing follows it as a low-pass filter of third order, so
    that the reference's acceleration, jerk and snap are continuous, or held. A drone that follows
    within 0.15 m, and is as its plan takes it to be, flies plans as they are, to the last bit.
    """

    RATE = 50.0  #: Hz, in a race

    def __init__(self, *, vehicle: Vehicle, rate: float, waits: bool = True):
        """Constructs the governor.

        Args:
            vehicle: mass and rotors, as in its file.
            rate: of updates (Hz).
            waits: whether it ever slows the clock.
        """
        LeafSystem.__init__(self)
        self._waits = waits
        self._forces = vehicle.max_thrusts / vehicle.mass
        self._as_in_file = np.ones(len(vehicle.rotors))
        self._plan = self.DeclareAbstractInputPort("lap_plan", Value[object](NO_PLAN))
        self._estimate = self.DeclareVectorInputPort("filtered_estimate", STATE_SIZE)
        self._factors = self.DeclareVectorInputPort("rotor_factors", len(vehicle.rotors))
        self._air = self.DeclareVectorInputPort("air", AIR_SIZE)
        clock = self.DeclareDiscreteState(REGULAR_VECTOR)
        self._needed = self.DeclareDiscreteState(1)  # slowing, for what comes
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / rate, 0.0, self._update)
        self.DeclarePeriodicDiscreteUpdateEvent(_PERIOD, 0.0, self._look_ahead)
        self.DeclareStateOutputPort("path_clock", clock)

    @classmethod
    def from_scenario(cls, scenario: "Scenario") -> Self:
        """Returns the governor of a scenario."""
        return cls(
            vehicle=load_vehicle(scenario.drone)[0], rate=cls.RATE, waits=scenario.planner.waits
        )

    def _update(self, context, discrete_state):
        plan, now = self._plan.Eval(context), context.get_time()
        if plan is NO_PLAN:
            return
        clock = as_clock(context.get_discrete_state(0).value())
        position = as_state(read_vector(self._estimate, context)).position
        error = needed = 0.0
        if self._waits and np.isfinite(position).all():
            error = float(np.linalg.norm(clock.reference(plan, now)[:3] - position))
            needed = float(context.get_discrete_state(self._needed).value()[0])
        after = _governed(clock, now, error, needed)
        if after is not clock:
            discrete_state.get_mutable_value(0)[:] = clock_vector(after)

    def _look_ahead(self, context, discrete_state):
        """Sets the slowing that the forces ahead need."""
        plan, air = self._plan.Eval(context), read_or(STILL_VECTOR, self._air, context)
        factors = read_or(self._as_in_file, self._factors, context)
        ahead = np.zeros((len(_AHEAD), 2, 3))  # a hover
        # Where nothing was learnt, every plan counts with just that.
        is_news = np.any(air != STILL_VECTOR) or np.any(factors != 1.0)
        if is_news and plan is not NO_PLAN:
            now, clock = context.get_time(), as_clock(context.get_discrete_state(0).value())
            time = now - clock.after(now).delay
            ahead[:] = [plan.derivatives(time + t)[1:3, :3] for t in _AHEAD]
        rate = _possible_rate(ahead, air, float(factors @ self._forces), _RATES)
        discrete_state.get_mutable_value(self._needed)[0] = 1.0 - rate


@compiled
def _possible_rate(ahead, air, most, rates):
    """Returns the first of some rates of the clock at which no force is greater than ``most``.

    Args:
        ahead: velocities and accelerations of the plan, (n, 2, 3).
        air: vector of an Air, (7,).
        most: of the specific force (m/s^2).
        rates: falling; if there is none, the last one is returned.
    """
    for rate in rates:
        greatest = 0.0
        for k in range(len(ahead)):
            velocity, force = rate * ahead[k, 0], rate**2 * ahead[k, 1] - GRAVITY_W
            z_B = force / max(math.sqrt(dot(force, force)), 1e-3)
            force = force - drag_acceleration(velocity, z_B, as_air(air))
            greatest = max(greatest, dot(force, force))
        if greatest <= most**2:
            return rate
    return rates[-1]


def _governed(clock: PathClock, now: float, error: float, needed: float = 0.0) -> PathClock:
    """Returns the clock from a time (s) on.

    Args: error: of the position (m). needed: slowing, for what comes.
    """
    behind = _SLOWEST * float(np.clip((error - _FREE) / (_MOST - _FREE), 0.0, 1.0))
    wanted = max(behind, needed)
    if clock.is_regular and wanted == 0.0:
        return clock
    now_clock, w = clock.after(now), _BANDWIDTH if needed > behind else _GENTLY
    _, delay, slowing, rate, acceleration, _ = now_clock
    # The poles of the filter are three times -w.
    jerk = w**3 * (wanted - slowing) - 3.0 * w**2 * rate - 3.0 * w * acceleration
    if wanted == 0.0 and max(map(abs, (slowing, rate / w, acceleration / w**2))) < _NOTHING:
        return REGULAR._replace(time=now, delay=delay)
    return now_clock._replace(slowing_jerk=jerk)
