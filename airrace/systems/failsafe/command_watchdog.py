"""What a flight controller does when the companion computer falls silent."""

import math
from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import Context

from airrace.common.packing import Packing
from airrace.math.quaternion import reference_yaw
from airrace.systems.leaf_system import LeafSystem
from airrace.trajopt.reference import REFERENCE_SIZE
from airrace.trajopt.stop import AIRBORNE, LOW, Stop
from airrace.vehicle.state import STATE_SIZE, as_state

# How old a command may be (s).
HOLD_AFTER, HOVER_AFTER, LAND_AFTER = 0.1, 0.5, 2.0
FOLLOW, HOLD, HOVER, LAND = range(4)  # modes
_NOTHING = np.full(REFERENCE_SIZE, np.nan)


class WatchdogMemory(NamedTuple):
    """What the watchdog remembers."""

    mode: float  #: FOLLOW, HOLD, HOVER or LAND
    last: float  #: when the newest command was sent (s)
    since: float  #: when the drone was last under command (s)
    landing: float  #: when the descent began (s)
    yaw: float  #: its heading then (rad)
    position: np.ndarray  #: p_WB then (m), (3,)
    velocity: np.ndarray  #: v_WB then (m/s), (3,)
    pad: float  #: height at which it stood at the start (m)
    airborne: float  #: whether it has taken off
    oldest: float  #: age of the oldest command that was in force (s)
    #: holds, hovers, landings: how often each began
    holds: float
    hovers: float
    landings: float


_PACKING = Packing(WatchdogMemory, position=3, velocity=3)
_as_memory, _memory_vector = _PACKING.parts, _PACKING.vector


class CommandWatchdog(LeafSystem):
    """Passes commands from a link to the rotors, and lands the drone without them.

    .. pydrake_system::

        name: CommandWatchdog
        input_ports:
        - rotor_speed_command
        - rotor_speed_command_time
        - own_command
        - state_estimate
        output_ports:
        - rotor_speed_command
        - reference

    ``rotor_speed_command`` is what came over the link, and
    ``rotor_speed_command_time`` when that was sent (s). While it is fresh it goes
    through. If it is older than 0.1 s, the last one is held; after 0.5 s
    ``own_command``, of a controller that follows ``reference``
    (a trajopt.Reference), levels the drone, brakes it and lets it hover;
    after 2 s it lands. While commands are fresh the reference is NaN, at which that
    controller rests. As soon as a fresh command comes, it is followed again,
    unless the drone is about to touch down. On the pad, the rotors idle.
    """

    def __init__(self, *, rotors: int, rate: float):
        """Constructs the watchdog. Args: rotors: how many. rate: of its updates (Hz)."""
        LeafSystem.__init__(self)
        self._command = self.DeclareVectorInputPort("rotor_speed_command", rotors)
        self._time = self.DeclareVectorInputPort("rotor_speed_command_time", 1)
        self._own = self.DeclareVectorInputPort("own_command", rotors)
        self._estimate = self.DeclareVectorInputPort("state_estimate", STATE_SIZE)
        self._memory = self.DeclareDiscreteState(
            _memory_vector(_as_memory(np.zeros(_PACKING.size))._replace(mode=FOLLOW, pad=math.nan))
        )
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / rate, 0.0, self._watch)
        self.DeclareVectorOutputPort(
            "rotor_speed_command",
            rotors,
            self._calc_command,
            {self._command.ticket(), self._own.ticket(), self.xd_ticket()},
        )
        self.DeclareVectorOutputPort(
            "reference",
            REFERENCE_SIZE,
            self._calc_reference,
            {self.xd_ticket(), self.time_ticket()},
        )

    def recall(self, context: Context) -> WatchdogMemory:
        """Returns what it remembers."""
        return _as_memory(context.get_discrete_state(self._memory).value())

    def _watch(self, context, discrete_state):
        m, now = self.recall(context), context.get_time()
        state = as_state(self._estimate.Eval(context))
        height = state.position[2]
        pad = height if math.isnan(m.pad) else m.pad
        airborne = 1.0 if height > pad + AIRBORNE else m.airborne
        last = max(m.last, min(float(self._time.Eval(context)[0]), now))
        age = now - last
        mode = int(age > HOLD_AFTER) + int(age > HOVER_AFTER) + int(age > LAND_AFTER)
        if m.mode == LAND and airborne and height < LOW:
            mode = LAND
        before = m.mode
        if mode >= HOLD and before < HOVER:
            yaw = reference_yaw(state.quaternion)
            m = m._replace(since=now, yaw=yaw, position=state.position, velocity=state.velocity)
        m = m._replace(
            mode=mode,
            last=last,
            landing=now if mode == LAND and before < LAND else m.landing,
            pad=pad,
            airborne=airborne,
            oldest=max(m.oldest, age),
            holds=m.holds + (mode >= HOLD and before < HOLD),
            hovers=m.hovers + (mode >= HOVER and before < HOVER),
            landings=m.landings + (mode == LAND and before < LAND),
        )
        discrete_state.set_value(self._memory, _memory_vector(m))

    def _calc_command(self, context, output):
        source = self._own if self.recall(context).mode >= HOVER else self._command
        output.set_value(source.Eval(context))

    def _calc_reference(self, context, output):
        m, now = self.recall(context), context.get_time()
        if m.mode == FOLLOW:
            output.set_value(_NOTHING)
            return
        stop = Stop(m.position, m.yaw, m.velocity, bool(m.airborne))
        sinking = now - m.landing if m.mode == LAND else None
        output.set_value(stop.reference(now - m.since, sinking))
