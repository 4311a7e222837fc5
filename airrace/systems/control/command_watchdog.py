"""What a flight controller does when the companion computer falls silent."""

import dataclasses as dc
import math
import operator

import numpy as np
from pydrake.systems.framework import LeafSystem

from airrace.systems.control.geometric_controller import GeometricController
from airrace.systems.control.rotor_monitor import RotorMonitor
from airrace.systems.control.state_filter import StateFilter
from airrace.systems.exploring.exploration import hover_pose
from airrace.trajopt.flat_trajectory import hold
from airrace.trajopt.reference import REFERENCE_SIZE, as_reference
from airrace.vehicle import load_vehicle
from airrace.vehicle.state import STATE_SIZE, as_state

# How old a command may be (s).
HOLD_AFTER, HOVER_AFTER, LAND_AFTER = 0.1, 0.5, 2.0
FOLLOW, HOLD, HOVER, LAND = range(4)  # modes
MODES = ("follow", "hold", "hover", "land")
_BRAKE = 6.0  # m/s^2, on the way to the hover
_DESCENT, _LAST_DESCENT = 2.0, 0.5  # m/s, and over the last metre
_LOW = 1.0  # m over the ground; from there a landing is finished
_AIRBORNE = 0.4  # m over where it stood
_BELOW = 3.0  # m under the pad: the rotors idle
_NOTHING = np.full(REFERENCE_SIZE, np.nan)


@dc.dataclass(slots=True)
class _Memory:
    """What the watchdog remembers, as one vector.

    ``last`` is when the newest command was sent, ``x`` to ``yaw`` where the drone
    was and how fast when it was left alone, at ``since``, or now while a command is
    held; ``landing`` when the descent began. The rest is for the record.
    """

    mode: float = FOLLOW
    last: float = 0.0
    since: float = 0.0
    landing: float = 0.0
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    vx: float = 0.0
    vy: float = 0.0
    vz: float = 0.0
    yaw: float = 0.0
    pad: float = math.nan
    airborne: float = 0.0
    oldest: float = 0.0
    holds: float = 0.0
    hovers: float = 0.0
    landings: float = 0.0

    def vector(self) -> np.ndarray:
        return np.array(_numbers(self))


_numbers = operator.attrgetter(*(field.name for field in dc.fields(_Memory)))


class CommandWatchdog(LeafSystem):
    """Stands between a link and the rotors.

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
    (trajopt/reference.py), levels the drone, brakes it and lets it hover;
    after 2 s it lands. While commands are fresh the reference is NaN, at which that
    controller rests. As soon as a fresh command comes, it is followed again,
    unless the drone is about to touch down. On the pad, the rotors idle.
    """

    def __init__(self, *, rotors: int, rate: float):
        """Constructs the watchdog. Args: rotors: how many. rate: of its looks (Hz)."""
        LeafSystem.__init__(self)
        self._command = self.DeclareVectorInputPort("rotor_speed_command", rotors)
        self._time = self.DeclareVectorInputPort("rotor_speed_command_time", 1)
        self._own = self.DeclareVectorInputPort("own_command", rotors)
        self._estimate = self.DeclareVectorInputPort("state_estimate", STATE_SIZE)
        self._memory = self.DeclareDiscreteState(_Memory().vector())
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

    def recall(self, context) -> _Memory:
        """Returns what it remembers."""
        return _Memory(*context.get_discrete_state(self._memory).value().tolist())

    def _watch(self, context, discrete_state):
        m = self.recall(context)
        now = context.get_time()
        estimate = self._estimate.Eval(context).tolist()
        height = as_state(estimate).position[2]
        if math.isnan(m.pad):
            m.pad = height
        if height > m.pad + _AIRBORNE:
            m.airborne = 1.0
        m.last = max(m.last, min(float(self._time.Eval(context)[0]), now))
        age = now - m.last
        m.oldest = max(m.oldest, age)
        mode = int(age > HOLD_AFTER) + int(age > HOVER_AFTER) + int(age > LAND_AFTER)
        if m.mode == LAND and m.airborne and height < _LOW:
            mode = LAND
        if mode >= HOLD and m.mode < HOVER:
            m.since = now
            m.x, m.y, m.z, m.yaw = hover_pose(np.array(estimate))
            m.vx, m.vy, m.vz = as_state(estimate).velocity
        m.hovers += mode >= HOVER and m.mode < HOVER
        if mode == LAND and m.mode < LAND:
            m.landing = now
            m.landings += 1
        if mode >= HOLD and m.mode < HOLD:
            m.holds += 1
        m.mode = mode
        discrete_state.set_value(self._memory, m.vector())

    def _calc_command(self, context, output):
        mode = context.get_discrete_state(self._memory).value()[0]
        source = self._own if mode >= HOVER else self._command
        output.set_value(source.Eval(context))

    def _calc_reference(self, context, output):
        m = self.recall(context)
        output.set_value(_NOTHING if m.mode == FOLLOW else stopping(m, context.get_time()))


def stopping(m: _Memory, time: float) -> np.ndarray:
    """Returns the reference of a drone that is left alone, (18,).

    It brakes evenly along the way it was flying, stays there, and sinks if it is
    to land.

    Args:
        m: where it was.
        time: now (s).
    """
    if not m.airborne:
        return hold([m.x, m.y, m.z - _BELOW], m.yaw)
    v = np.array([m.vx, m.vy, m.vz])
    speed = math.hypot(*v)
    t = min(time - m.since, speed / _BRAKE)
    braking = time - m.since < speed / _BRAKE
    direction = v / max(speed, 1e-9)
    result = hold(np.array([m.x, m.y, m.z]) + (speed * t - _BRAKE * t * t / 2) * direction, m.yaw)
    if braking:
        as_reference(result).velocity[:] = (speed - _BRAKE * t) * direction
        as_reference(result).acceleration[:] = -_BRAKE * direction
    if m.mode == LAND:
        # Fast down to the last metre, and slowly on, beneath the ground.
        z, falling = result[2], time - m.landing
        quick = max(z - _LOW, 0.0) / _DESCENT
        rate = _DESCENT if falling < quick else _LAST_DESCENT
        result[2] = (
            z - _DESCENT * falling
            if falling < quick
            else min(z, _LOW) - _LAST_DESCENT * (falling - quick)
        )
        as_reference(result).velocity[2] -= rate
    return result


def AddCommandWatchdog(builder, scenario, simulation, link) -> CommandWatchdog:
    """Adds a watchdog, with a controller of its own, before a simulation's rotors.

    Args:
        builder: of the race.
        scenario: the race.
        simulation: its diagram, whose input ``rotor_speed_command`` is connected.
        link: has the output ports ``rotor_speed_command`` and ``..._time``.
    """
    vehicle, rate = load_vehicle(scenario.drone)[0], scenario.controller.rate
    add = builder.AddNamedSystem
    watchdog = add("command_watchdog", CommandWatchdog(rotors=len(vehicle.rotors), rate=rate))
    systems = (
        watchdog,
        link,
        simulation,
        add("own_rotor_monitor", RotorMonitor(vehicle=vehicle, rate=scenario.rotor_monitor.rate)),
        add(
            "own_state_filter",
            StateFilter(
                vehicle=vehicle,
                state_rate=scenario.state_estimate.rate,
                rate=scenario.state_filter.rate,
            ),
        ),
        controller := add("own_controller", GeometricController(vehicle=vehicle, rate=rate)),
    )
    builder.Connect(controller.get_output_port(), watchdog.GetInputPort("own_command"))
    for name in ("rotor_speed_command", "rotor_speed_command_time"):
        builder.Connect(link.GetOutputPort(name), watchdog.GetInputPort(name))
    builder.Connect(
        simulation.GetOutputPort("state_estimate"), watchdog.GetInputPort("state_estimate")
    )
    for box in systems[3:]:
        for i in range(box.num_input_ports()):
            port = box.get_input_port(i)
            source = next(b for b in (watchdog, *systems[2:]) if b.HasOutputPort(port.get_name()))
            builder.Connect(source.GetOutputPort(port.get_name()), port)
    builder.Connect(
        watchdog.GetOutputPort("rotor_speed_command"),
        simulation.GetInputPort("rotor_speed_command"),
    )
    return watchdog
