"""The place of the autonomy in a race that a client flies, over MAVLink."""

import dataclasses as dc
import time as wall_clock
from typing import TYPE_CHECKING

from airrace.common.errors import UserError
from airrace.diagrams.transport import POLL_PERIOD, Transport
from airrace.diagrams.wiring import connect_by_name, outputs_of
from airrace.mavlink.bridge import AFTER, EARLY_START, MavlinkBridge, is_command
from airrace.mavlink.flight_controller import MakeFlightController
from airrace.systems.failsafe.setpoint_watchdog import FOLLOW, HOVER, LAND, OFF, SetpointWatchdog
from airrace.systems.referee import OUT_OF_TIME
from airrace.track import load_track
from airrace.vehicle import load_vehicle

if TYPE_CHECKING:
    from pydrake.systems.analysis import Simulator
    from pydrake.systems.framework import Diagram, DiagramBuilder, System

    from airrace.mavlink.client_link import ClientLink
    from airrace.scenario import Scenario

RESET_BY_CLIENT = "reset by the client"
_GREETING = 0.1  # s, between two heartbeats while nobody has answered yet
_ANSWER = 2.0  # s, that a client may take to answer in steps, before the time goes on without
_ROUNDING = 1e-6  # s, by which a step goes on after its message, whatever sums of periods round to
_FAREWELL = 1.0  # s of simulated time after the end, in which the client learns of it
# What is said when the watchdog takes over from a client that is silent, or hands back.
_WATCHDOG_LINES = {
    HOVER: "no set-points any more: the drone hovers",
    LAND: "still no set-points: the drone is set down",
    OFF: "no set-points: the motors have stopped",
    FOLLOW: "set-points come again",
}


class ClientTransport(Transport):
    """Joins a simulation to a client: see airrace/diagrams/transport.py.

    In real time, time goes on from the beginning, as in the official simulator. As fast as it can
    and in steps, it waits for the first word of the client. In steps, it also waits for one command
    after every HIGHRES_IMU. A client that has not answered for two seconds is not waited for again
    until its next command. One that sends more than one command is obeyed, but what comes late
    counts as the next answer, and how late it comes depends on the computer.

    Attributes:
        bridge: of the diagram that was built.
        reset_wanted: whether the client has asked to begin anew.
    """

    simulation = "MAVLINK"
    bridge: MavlinkBridge
    _watchdog: SetpointWatchdog

    def __init__(self, scenario: "Scenario", link: "ClientLink", before: float | None = None):
        """Constructs the transport.

        Args:
            scenario: the race.
            link: to the client; it stays open after the race.
            before: how long races in the same process have lasted (s), None for the first.
        """
        self._before = before
        self._link, self._config = link, scenario.mavlink
        self._imu_rate = scenario.imu.rate
        self._waits = self._config.step or not scenario.simulator_config.target_realtime_rate
        self._idle, self._samples, self._silent = 0.0, 0, False
        self._phase, self._took_over = FOLLOW, {HOVER: 0, LAND: 0, OFF: 0}
        self._unanswered = self._commands = 0

    @property
    def reset_wanted(self) -> bool:
        return self.bridge.reset_wanted

    def AddToBuilder(
        self, builder: "DiagramBuilder", scenario: "Scenario", simulation: "Diagram"
    ) -> "System":
        track = load_track(scenario.track)
        if track.has_markers:
            raise UserError(
                f"The track {track.name} has pylons; a client flies square gates: take "
                "`--track grand-prix`, or make one with `airrace track --kind square`."
            )
        vehicle, _ = load_vehicle(scenario.drone)
        if len(vehicle.rotors) != 4:
            raise UserError(
                f"A client flies drones of four rotors, which the {vehicle.name} is not."
            )
        controller = builder.AddSystem(
            MakeFlightController(scenario, track, vehicle, self._link, self._before)
        )
        self.bridge = controller.GetSubsystemByName("mavlink_bridge")
        self._watchdog = controller.GetSubsystemByName("setpoint_watchdog")
        connect_by_name(builder, [controller], outputs_of(simulation))
        connect_by_name(builder, [simulation], outputs_of(controller))
        return controller

    def advance(self, simulator: "Simulator", time: float) -> str | None:
        if self._waits and not self._link.heard:
            self.bridge.greet()
            self._link.wait(_GREETING)
            self._link.drain()
            self._idle += POLL_PERIOD
            return None
        end = time - self._idle
        if self._config.step:
            self._advance_in_steps(simulator, end)
        else:
            simulator.AdvanceTo(end)
        if self.reset_wanted:
            return RESET_BY_CLIENT
        self._tell_watchdog(simulator)
        context = self.bridge.GetMyContextFromRoot(simulator.get_context())
        flight = self.bridge.flight(context)
        if flight.early >= 0.0:
            return EARLY_START
        over = simulator.get_context().get_time() >= flight.start + self._config.time_limit
        return OUT_OF_TIME if flight.begun and over else None

    def _tell_watchdog(self, simulator):
        """Counts and says that nobody flies the drone any more, or again."""
        context = simulator.get_context()
        phase = self._watchdog.phase(self._watchdog.GetMyContextFromRoot(context))
        if phase == self._phase:
            return
        self._phase = phase
        if phase != FOLLOW:
            self._took_over[phase] += 1
        self._link.note(f"[{context.get_time():7.1f} s] {_WATCHDOG_LINES[phase]}")

    def _advance_in_steps(self, simulator, end):
        """Advances, and waits for a command after each HIGHRES_IMU."""
        while not self.reset_wanted:
            due = self._samples / self._imu_rate + AFTER + _ROUNDING
            if due > end:
                simulator.AdvanceTo(end)
                return
            told = self.bridge.imu_messages
            simulator.AdvanceTo(due)
            self._samples += 1
            if self.bridge.imu_messages > told:
                context = self.bridge.GetMyContextFromRoot(simulator.get_context())
                # A client that hears of its finish may leave.
                if not self._await_command() and not self.bridge.finished(context):
                    self._unanswered += 1

    def _await_command(self):
        """Waits for a command, but not again for a client that was silent; returns if one came."""
        if self.bridge.commands > self._commands:
            self._silent = False
        self._commands = self.bridge.commands
        limit = wall_clock.monotonic() + (0.0 if self._silent else _ANSWER)
        while True:
            self._link.drain()
            if any(is_command(message) for message in self._link.messages):
                self._silent = False
                return True
            left = limit - wall_clock.monotonic()
            if left <= 0.0:
                self._silent = True
                return False
            self._link.wait(left)

    def end(self, simulator: "Simulator") -> None:
        """Goes on for a second, in which the client learns that the race is over."""
        if not self.reset_wanted and self._link.heard:
            self._silent = True  # who is done answers no more
            simulator.AdvanceTo(simulator.get_context().get_time() + _FAREWELL)

    def wall(self, simulator: "Simulator") -> dict:
        counts = dc.asdict(self._link.counts)
        hovers, landings, stops = (self._took_over[phase] for phase in (HOVER, LAND, OFF))
        watchdog = {"hovers": hovers, "landings": landings, "stops": stops}
        return {"link": {**counts, "unanswered": self._unanswered, "watchdog": watchdog}}
