"""HITL: the autonomy of a race is at the other end of a link."""

import dataclasses as dc
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from airrace.common.errors import UserError
from airrace.common.processes import ending
from airrace.common.words import printable
from airrace.diagrams.command_watchdog import AddCommandWatchdog
from airrace.diagrams.transport import POLL_PERIOD, Transport
from airrace.hitl.lcm_sender import LcmSender
from airrace.hitl.link import phases
from airrace.hitl.link.endpoint import HEARTBEAT_PERIOD, SIMULATION, Endpoint
from airrace.hitl.link.lockstep import Exchange, PeerLost, await_peer, lockstep_times
from airrace.hitl.received_ports import LcmReceiver
from airrace.systems.failsafe.command_watchdog import HOVER, LAND

if TYPE_CHECKING:
    from pydrake.systems.analysis import Simulator
    from pydrake.systems.framework import Context, Diagram, DiagramBuilder, System

    from airrace.hitl.channels import PortChannel
    from airrace.scenario import Scenario
    from airrace.systems.types import RefereeStatus

LOCKSTEP, REAL_TIME = "lockstep", "realtime"  # the modes that the simulation's heartbeats say
_TICK = 0.001  # s between polls of the link
_BEHIND = 0.1  # s of the wall's clock that the simulation catches up; the rest is lost
_LAST_HEARTBEATS = 5
_PATIENCE = 30.0  # s


class Remote(Transport):
    """What the two ways of racing over a link have in common; see Transport for the methods."""

    simulation = "HITL"
    mode = ""

    def __init__(
        self,
        channels: "Sequence[PortChannel]",
        endpoint: Endpoint,
        poll: Callable[[], int | None] = lambda: None,
    ):
        """Constructs the transport.

        Args:
            poll: called again and again, for the log of the autonomy's process; returns
                its exit code if it has ended.
        """
        self._channels, self._endpoint, self._poll = channels, endpoint, poll
        endpoint.partners.me.mode = self.mode
        self._shown = -1.0
        self._code: int | None = None  # with which the autonomy's process ended

    def _has_ended(self) -> bool:
        """Whether the autonomy's process is there no more, as far as that can be known here."""
        if self._code is None:
            self._code = self._poll()
        return self._code is not None

    def _await_ready(self, poll: Callable[[], object] = lambda: None) -> None:
        """Waits until the autonomy is ready, and calls poll() meanwhile.

        Raises UserError if it is not ready in time, or ends.
        """

        def look():
            if self._has_ended():
                raise UserError(f"The autonomy's process {self._end()} before the race.")
            poll()

        await_peer(self._endpoint, phases.READY, timeout=_PATIENCE, poll=look)

    def _end(self) -> str:
        """Returns how the autonomy's process ended, in words."""
        assert self._code is not None
        return ending(self._code)

    def _reason_given(self) -> str:
        """Returns why the autonomy fell silent, in brackets, as far as that is known."""
        self._has_ended()
        said = printable(self._endpoint.peer_heartbeat.value.text[:300])
        if not said and self._code is not None:
            said = f"its process {self._end()}"
        return f" ({said})" if said else ""

    def AddToBuilder(
        self, builder: "DiagramBuilder", scenario: "Scenario", simulation: "Diagram"
    ) -> "System":
        autonomy = builder.AddNamedSystem("autonomy", LcmReceiver(self._channels, SIMULATION))
        self._add_command(builder, scenario, simulation, autonomy)  # type: ignore[attr-defined]
        builder.Connect(
            autonomy.GetOutputPort("explorer_status"), simulation.GetInputPort("explorer_status")
        )
        lossless = self.mode == LOCKSTEP
        self._receiver = autonomy
        self._sender = LcmSender(simulation, self._channels, SIMULATION, self._endpoint, lossless)
        return autonomy

    def end(self, simulator: "Simulator") -> None:
        for _ in range(_LAST_HEARTBEATS):
            self._endpoint.send_heartbeat(phases.OVER, simulator.get_context().get_time())
            time.sleep(HEARTBEAT_PERIOD / 5)

    def wall(self, simulator: "Simulator") -> dict:
        round_trip = self._endpoint.clock.round_trip
        return {"link": {"mode": self.mode, "round_trip_s": round_trip, **self._endpoint.summary()}}


class LockstepRemote(Remote):
    """Tick by tick: the same race as SITL, to the last bit."""

    mode = LOCKSTEP
    _over: str | None = None  # why the race cannot go on

    def _add_command(self, builder, scenario, simulation, autonomy):
        builder.Connect(
            autonomy.GetOutputPort("rotor_speed_command"),
            simulation.GetInputPort("rotor_speed_command"),
        )
        self._times = lockstep_times(scenario, POLL_PERIOD)

    def begin(self, simulator: "Simulator") -> None:
        self._meet()
        self._exchange = Exchange(self._endpoint, self._receiver, self._sender)
        next(self._times)
        self._over = self._step(simulator.get_mutable_context())
        self._next = next(self._times)

    def advance(self, simulator: "Simulator", end: float) -> str | None:
        context = simulator.get_mutable_context()
        while self._over is None and self._next <= end:
            simulator.AdvanceTo(self._next)
            self._over = self._step(context)
            self._next = next(self._times)
        return self._over

    def _meet(self) -> None:
        """Waits until the autonomy is ready."""
        self._await_ready()

    def _step(self, context: "Context") -> str | None:
        """Exchanges the messages of one step; returns why the race cannot go on, or None."""
        self._exchange.send(context)
        try:
            left = self._exchange.receive(context, stop=self._has_left)
        except PeerLost as e:
            return f"the autonomy fell silent for {e.args[0]:.0f} s{self._reason_given()}"
        return f"the autonomy left the race{self._reason_given()}" if left else None

    def _has_left(self) -> bool:
        """Whether the autonomy's process has ended, or says that it does."""
        return self._has_ended() or bool(self._endpoint.peer_heartbeat.value.text)


class RealTimeRemote(Remote):
    """Paced by the wall's clock, with the flight controller's watchdog in between."""

    mode = REAL_TIME

    def __init__(
        self,
        channels: "Sequence[PortChannel]",
        endpoint: Endpoint,
        poll: Callable[[], int | None] = lambda: None,
        rate: float = 1.0,
    ):
        """Args: rate: seconds of simulated time a second. The others: see Remote."""
        super().__init__(channels, endpoint, poll)
        self._rate = endpoint.partners.me.rate = rate
        self._start = self._late = 0.0  # by the endpoint's clock, s
        self._ticks = 0

    def _add_command(self, builder, scenario, simulation, autonomy):
        self._watchdog = AddCommandWatchdog(builder, scenario, simulation, autonomy)

    def begin(self, simulator: "Simulator") -> None:
        context = simulator.get_mutable_context()
        self._await_ready(lambda: self._send_initial_values(context))
        self._endpoint.clock.rate = self._rate
        self._endpoint.clock.restart()
        self._start = self._endpoint.now()

    def _send_initial_values(self, context):
        """Sends what the autonomy needs to begin, again and again: messages get lost."""
        if self._endpoint.now() - self._shown > 2 * HEARTBEAT_PERIOD:
            self._shown = self._endpoint.now()
            self._sender.forget()
            self._sender.send(context)

    def advance(self, simulator: "Simulator", end: float) -> str | None:
        self._has_ended()
        context = simulator.get_mutable_context()
        # Counted, not added up, so that the plant's own steps are not cut.
        while context.get_time() < end:
            tick = min((self._ticks + 1) * _TICK, end)
            self._wait_for(tick, context.get_time())
            self._receiver.receive(context, self._endpoint)
            simulator.AdvanceTo(tick)
            self._sender.send(context)
            self._ticks += tick < end or tick == (self._ticks + 1) * _TICK
        return self._given_up(context)

    def _wait_for(self, tick, sim_time):
        """Drains the link until the clock has come to a simulated time (s)."""
        due = self._start + self._late + tick / self._rate
        while True:
            now = self._endpoint.now()
            self._endpoint.beat(phases.RACING, sim_time)
            self._endpoint.drain()
            if now >= due:
                self._late += max(now - due - _BEHIND, 0.0)
                return
            self._endpoint.wait(due - now)

    def wall(self, simulator: "Simulator") -> dict:
        m = self._watchdog_memory(simulator.get_context())
        result = super().wall(simulator)
        result["link"] |= {
            "late_s": self._late,
            "watchdog": {
                "oldest_command_s": m.oldest,
                "holds": int(m.holds),
                "hovers": int(m.hovers),
                "landings": int(m.landings),
            },
        }
        return result

    def judged(self, status: "RefereeStatus", simulator: "Simulator") -> "RefereeStatus":
        m = self._watchdog_memory(simulator.get_context())
        if status.dnf_reason is None:
            return status
        if m.mode < HOVER:
            reason = self._reason_given() if self._has_ended() else ""
            return dc.replace(status, dnf_reason=status.dnf_reason + reason)
        silent = f"the autonomy fell silent at {m.last:.1f} s{self._reason_given()}"
        if m.mode == LAND and status.dnf_reason.startswith("hit the ground"):
            return dc.replace(
                status, dnf_reason=f"{silent}, and the drone landed by itself", collisions=0
            )
        return dc.replace(status, dnf_reason=f"{status.dnf_reason}: {silent}")

    def _given_up(self, context: "Context") -> str | None:
        """Returns why a drone that has not taken off never will, or None."""
        m = self._watchdog_memory(context)
        if m.mode == LAND and not m.airborne:
            return (
                f"the autonomy fell silent at {m.last:.1f} s, before the drone had taken off"
                f"{self._reason_given()}"
            )
        return None

    def _watchdog_memory(self, context):
        return self._watchdog.recall(self._watchdog.GetMyContextFromRoot(context))
