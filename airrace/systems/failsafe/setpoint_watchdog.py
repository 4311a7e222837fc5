"""What the drone does when nobody sends set-points any more."""

from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import Context

from airrace.common.immutable import read_only
from airrace.common.packing import Packing
from airrace.math.quaternion import reference_yaw
from airrace.systems.control.setpoint import (
    IDLE,
    NO_SETPOINT,
    POSITION,
    SETPOINT_SIZE,
    as_setpoint,
    setpoint_vector,
)
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_vector
from airrace.vehicle.state import STATE_SIZE, as_state

SILENCE = 0.5  # s without a set-point, after which the watchdog takes over
HOVER_TIME = 3.0  # s, of hovering before it lands
LANDING_SPEED = 0.5  # m/s
_UP = read_only(np.array((0.0, 0.0, 1.0)))
_LOW = 0.2  # m above where it stands at the start: below, the drone stands
_TOUCHDOWN = 0.3  # m, by which it stays behind on its way down once the ground carries it
_RATE = 100.0  # Hz
FOLLOW, HOVER, LAND, OFF = range(4)


class Watch(NamedTuple):
    """What the watchdog remembers."""

    phase: float  #: FOLLOW, HOVER, LAND or OFF
    since: float  #: when it began (s)
    position: np.ndarray  #: where it holds the drone (m), (3,)
    yaw: float  #: and where that looks (rad)


_PACKING = Packing(Watch, position=3)
_as_watch, _watch_vector = _PACKING.parts, _PACKING.vector


class SetpointWatchdog(LeafSystem):
    """Hands set-points on while they come; else it hovers and lands, or stops the motors.

    .. pydrake_system::

        name: SetpointWatchdog
        input_ports:
        - setpoint
        - filtered_estimate
        output_ports:
        - watched_setpoint

    ``setpoint`` and ``watched_setpoint`` are Setpoints (33), ``filtered_estimate`` is a
    vehicle.State (14). After SILENCE without a new set-point, a drone that is armed and low has
    its motors stopped; one in the air hovers for HOVER_TIME where it was, and is then set down:
    its place goes down at LANDING_SPEED until the drone does not follow, as the ground carries it.
    With the next set-point it follows again.
    """

    def __init__(self, *, standing_height: float):
        """Args: standing_height: of the body's origin on the pad (m)."""
        LeafSystem.__init__(self)
        self._low = standing_height + _LOW
        self._setpoint = self.DeclareVectorInputPort("setpoint", SETPOINT_SIZE)
        self._estimate = self.DeclareVectorInputPort("filtered_estimate", STATE_SIZE)
        self._memory = self.DeclareDiscreteState(_PACKING.size)
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / _RATE, 0.0, self._watch)
        self.DeclareVectorOutputPort(
            "watched_setpoint",
            SETPOINT_SIZE,
            self._calc_setpoint,
            {self.xd_ticket(), self._setpoint.ticket(), self.time_ticket()},
        )

    def phase(self, context: Context) -> int:
        """Returns what it does: FOLLOW, HOVER, LAND or OFF; context: of this system."""
        return int(_as_watch(context.get_discrete_state(self._memory).value()).phase)

    def _watch(self, context, discrete_state):
        setpoint = as_setpoint(read_vector(self._setpoint, context))
        memory = discrete_state.get_mutable_value(self._memory)
        watch, time = _as_watch(memory), context.get_time()
        if not setpoint.armed or time - setpoint.time <= SILENCE:
            phase = FOLLOW
        else:
            state = as_state(read_vector(self._estimate, context))
            height, seconds = state.position[2], time - watch.since
            low = height < self._low
            if watch.phase == LAND:
                low = height > _place(watch, seconds)[2] + _TOUCHDOWN
            phase = _next_phase(int(watch.phase), bool(low), seconds)
            if watch.phase == FOLLOW:
                yaw = reference_yaw(state.quaternion)
                memory[:] = _watch_vector(watch._replace(position=state.position, yaw=yaw))
        if phase != watch.phase:
            memory[:] = _watch_vector(_as_watch(memory)._replace(phase=phase, since=time))

    def _calc_setpoint(self, context, output):
        vector = read_vector(self._setpoint, context)
        watch = _as_watch(context.get_discrete_state(self._memory).value())
        if watch.phase == FOLLOW:
            output.SetFromVector(vector)
            return
        wanted = as_setpoint(vector)
        held = NO_SETPOINT._replace(kind=IDLE, time=wanted.time, armed=wanted.armed)
        if watch.phase != OFF:
            place = _place(watch, context.get_time() - watch.since)
            held = held._replace(kind=POSITION, position=place, yaw=watch.yaw, has_yaw=1.0)
            if watch.phase == LAND:
                held = held._replace(velocity=-LANDING_SPEED * _UP)
        output.SetFromVector(setpoint_vector(held))


def _place(watch: Watch, seconds: float) -> np.ndarray:
    """Returns where the drone is held (m), (3,), so many seconds after the phase began."""
    down = LANDING_SPEED * seconds if watch.phase == LAND else 0.0
    return watch.position - down * _UP


def _next_phase(phase: int, low: bool, seconds: float) -> int:
    """Returns what to do when nobody sends.

    Args: phase: what it does. seconds: for how long it has. low: whether it stands.
    """
    if low or phase == OFF:
        return OFF
    if phase == HOVER and seconds >= HOVER_TIME:
        return LAND
    return HOVER if phase == FOLLOW else phase
