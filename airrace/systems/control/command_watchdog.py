"""What a flight controller does when the companion computer falls silent."""

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, System

from airrace.scenario import VIO
from airrace.systems.control.geometric_controller import GeometricController
from airrace.systems.control.rotor_monitor import RotorMonitor
from airrace.systems.control.state_filter import StateFilter
from airrace.systems.estimation.of_scenario import make_strapdown_integrator
from airrace.systems.exploring.exploration import hover_pose
from airrace.systems.leaf_system import LeafSystem
from airrace.trajopt.flat_trajectory import hold, idle
from airrace.trajopt.reference import REFERENCE_SIZE, as_reference
from airrace.vehicle import load_vehicle
from airrace.vehicle.state import STATE_SIZE, as_state

if TYPE_CHECKING:
    from airrace.scenario import Scenario

# How old a command may be (s).
HOLD_AFTER, HOVER_AFTER, LAND_AFTER = 0.1, 0.5, 2.0
FOLLOW, HOLD, HOVER, LAND = range(4)  # modes
BRAKE = 6.0  # m/s^2, before the hover
_DESCENT, _LAST_DESCENT = 2.0, 0.5  # m/s, and over the last metre
_QUICKENING = 0.1  # m/s^2, beneath the ground: whoever is still in the air has a wrong height
_LOW = 1.0  # m over the ground; from there a landing is finished
AIRBORNE = 0.4  # m over where it stood
_NOTHING = np.full(REFERENCE_SIZE, np.nan)


class WatchdogMemory(NamedTuple):
    """What the watchdog remembers, as a vector of numbers.

    Attributes:
        mode: FOLLOW, HOLD, HOVER or LAND.
        last: when the newest command was sent (s).
        since: when the drone was last under command (s).
        landing: when the descent began (s).
        x, y, z, yaw: its pose then (m, rad). vx, vy, vz: its velocity then (m/s).
        pad: height at which it stood at the start (m).
        airborne: whether it has taken off.
        oldest: age of the oldest command that was in force (s).
        holds, hovers, landings: how often each began.
    """

    mode: float = FOLLOW
    last: float = 0.0
    since: float = 0.0
    landing: float = 0.0
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    yaw: float = 0.0
    vx: float = 0.0
    vy: float = 0.0
    vz: float = 0.0
    pad: float = math.nan
    airborne: float = 0.0
    oldest: float = 0.0
    holds: float = 0.0
    hovers: float = 0.0
    landings: float = 0.0


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
        self._memory = self.DeclareDiscreteState(np.array(WatchdogMemory()))
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
        return WatchdogMemory(*context.get_discrete_state(self._memory).value().tolist())

    def _watch(self, context, discrete_state):
        m, now = self.recall(context), context.get_time()
        estimate = self._estimate.Eval(context)
        state = as_state(estimate)
        height = state.position[2]
        pad = height if math.isnan(m.pad) else m.pad
        airborne = 1.0 if height > pad + AIRBORNE else m.airborne
        last = max(m.last, min(float(self._time.Eval(context)[0]), now))
        age = now - last
        mode = int(age > HOLD_AFTER) + int(age > HOVER_AFTER) + int(age > LAND_AFTER)
        if m.mode == LAND and airborne and height < _LOW:
            mode = LAND
        before = m.mode
        if mode >= HOLD and before < HOVER:
            x, y, z, yaw = hover_pose(estimate)
            vx, vy, vz = state.velocity
            m = m._replace(since=now, x=x, y=y, z=z, yaw=yaw, vx=vx, vy=vy, vz=vz)
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
        discrete_state.set_value(self._memory, np.array(m))

    def _calc_command(self, context, output):
        source = self._own if self.recall(context).mode >= HOVER else self._command
        output.set_value(source.Eval(context))

    def _calc_reference(self, context, output):
        m = self.recall(context)
        output.set_value(_NOTHING if m.mode == FOLLOW else stopping(m, context.get_time()))


def stopping(m: WatchdogMemory, time: float) -> np.ndarray:
    """Returns the reference of a drone that is left alone, (18,).

    It brakes evenly in the direction of flight, stays there, and descends if it is
    to land. If the ground does not come where it should be, the estimate believes that the drone
    sinks faster than it does, and more so with time: so it sinks ever faster.

    Args:
        m: where it was.
        time: now (s).
    """
    if not m.airborne:
        return idle([m.x, m.y, m.z], m.yaw)
    p, v = np.array([m.x, m.y, m.z]), np.array([m.vx, m.vy, m.vz])
    speed = math.hypot(*v)
    direction = v / max(speed, 1e-9)
    t = min(time - m.since, speed / BRAKE)
    result = hold(p + (speed * t - BRAKE * t * t / 2) * direction, m.yaw)
    reference = as_reference(result)
    if time - m.since < speed / BRAKE:
        reference.velocity[:] = (speed - BRAKE * t) * direction
        reference.acceleration[:] = -BRAKE * direction
    if m.mode == LAND:
        # Fast down to the last metre, slowly on, and beneath the ground ever faster.
        z, elapsed = reference.position[2], time - m.landing
        low = min(z, _LOW)
        fast = (z - low) / _DESCENT
        if elapsed < fast:
            height, rate = z - _DESCENT * elapsed, _DESCENT
        else:
            slow = elapsed - fast
            beneath = max(slow - max(low, 0.0) / _LAST_DESCENT, 0.0)
            height = low - _LAST_DESCENT * slow - _QUICKENING * beneath**2 / 2
            rate = _LAST_DESCENT + _QUICKENING * beneath
        reference.position[2] = height
        reference.velocity[2] -= rate
    return result


def AddCommandWatchdog(
    builder: DiagramBuilder, scenario: "Scenario", simulation: Diagram, link: System
) -> CommandWatchdog:
    """Adds a watchdog, with a controller of its own, before a simulation's rotors.

    Args:
        builder: of the race.
        scenario: the race.
        simulation: its diagram, whose input ``rotor_speed_command`` is connected.
        link: has the output ports ``rotor_speed_command`` and ``..._time``; with the estimator
            ``vio`` also ``corrections``: nobody tells the flight controller either where it is, so
            it goes on by its inertial sensor from the last correction that came.
    """
    vehicle, rate = load_vehicle(scenario.drone)[0], scenario.controller.rate
    add = builder.AddNamedSystem
    watchdog = add("command_watchdog", CommandWatchdog(rotors=len(vehicle.rotors), rate=rate))
    if scenario.estimator == VIO:
        estimator = add("own_strapdown_integrator", make_strapdown_integrator(scenario))
        knows = estimator
    else:
        knows = simulation
        estimator = add(
            "own_state_filter",
            StateFilter(
                vehicle=vehicle,
                state_rate=scenario.state_estimate.rate,
                rate=scenario.state_filter.rate,
            ),
        )
    systems = (
        watchdog,
        link,
        simulation,
        add("own_rotor_monitor", RotorMonitor(vehicle=vehicle, rate=scenario.rotor_monitor.rate)),
        estimator,
        controller := add("own_controller", GeometricController(vehicle=vehicle, rate=rate)),
    )
    builder.Connect(controller.get_output_port(), watchdog.GetInputPort("own_command"))
    for name in ("rotor_speed_command", "rotor_speed_command_time"):
        builder.Connect(link.GetOutputPort(name), watchdog.GetInputPort(name))
    builder.Connect(knows.GetOutputPort("state_estimate"), watchdog.GetInputPort("state_estimate"))
    for box in systems[3:]:
        for i in range(box.num_input_ports()):
            port = box.get_input_port(i)
            every = (watchdog, *systems[2:], link)
            source = next(b for b in every if b.HasOutputPort(port.get_name()))
            builder.Connect(source.GetOutputPort(port.get_name()), port)
    builder.Connect(
        watchdog.GetOutputPort("rotor_speed_command"),
        simulation.GetInputPort("rotor_speed_command"),
    )
    return watchdog
