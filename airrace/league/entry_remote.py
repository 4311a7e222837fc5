"""The simulation's end of a race whose autonomy is an entry in a sandbox."""

import contextlib
import dataclasses as dc
import time
from typing import TYPE_CHECKING, Any

from airrace.common.patience import patient
from airrace.common.words import printable
from airrace.hitl.channels import OPTIONAL_PORTS, make_channels
from airrace.hitl.link import packets, phases
from airrace.hitl.link.endpoint import AUTONOMY, HEARTBEAT, SIMULATION, Endpoint
from airrace.hitl.link.lockstep import PeerLost, await_peer
from airrace.hitl.link.socket_bus import SocketBus
from airrace.hitl.remote_autonomy import LockstepRemote
from airrace.lcmtypes import lcmt_heartbeat
from airrace.scenario import Scenario

if TYPE_CHECKING:
    from collections.abc import Iterable

    from pydrake.systems.analysis import Simulator
    from pydrake.systems.framework import Context

    from airrace.hitl.channels import PortChannel
    from airrace.league.sandbox import EntryProcess
    from airrace.league.season import Limits

_MOST_SENT = 64 << 20  # bytes in one step
_MOST_WAITING = 1000  # messages that belong to no step
_LAST_WORDS = 5.0  # s from the end of the socket to the end of the process


class EntryFailed(Exception):
    """The entry could not begin to race; the argument is a clause that says why."""


@dc.dataclass
class Conduct:
    """How an entry behaved."""

    steps: int = 0  # of the link
    missed_deadlines: int = 0  # steps that took more processor time than limits.step_cpu
    longest_step_s: float = 0.0  # processor time of the longest (s)
    cpu_s: float = 0.0  # of the process, from its start (s)


class GuardedBus(SocketBus):
    """A SocketBus that notices if the other side is not what it should be."""

    allowed: tuple[str, ...] = ()  # names of the channels that the other side may send on
    violation: str | None = None  # a clause on what it did, or None
    _at_step = 0  # bytes received before this step

    def begin_step(self) -> None:
        """Counts what comes from zero."""
        self._at_step = self.received

    def _take(self, channel: str, data: bytes) -> None:
        if self.received - self._at_step > _MOST_SENT:
            self.violation = f"it sent more than {_MOST_SENT >> 20} MB in one step"
        elif channel == HEARTBEAT:
            with contextlib.suppress(packets.Dropped):  # it is no heartbeat
                if packets.decode(data, lcmt_heartbeat).role != AUTONOMY:
                    self.violation = "it spoke as the simulation"
        elif channel not in self.allowed:
            self.violation = (
                f"it sent on {printable(channel[:60])}, which is not a channel of the autonomy"
            )
        if self.violation is None:
            super()._take(channel, data)


class EntryRemote(LockstepRemote):
    """Races tick by tick with an entry, and ends the race if it breaks a rule.

    Attributes:
        conduct: of the entry so far.
    """

    def __init__(
        self,
        channels: "Iterable[PortChannel]",
        endpoint: Endpoint,
        bus: GuardedBus,
        start: "EntryStart",
        limits: "Limits",
    ):
        """Args: as meet_entry() has them."""
        super().__init__(tuple(channels), endpoint)
        self._bus, self._start, self._limits = bus, start, limits
        self._process = start.process
        self.conduct = Conduct()
        self._waited = 0.0  # for all steps before this one (s)
        self._began, self._cpu = time.monotonic(), 0.0  # of this step: wall's clock, processor (s)
        self._reason: str | None = None
        self._late = f"the entry did not answer within {limits.step_wall:g} s"

    def begin(self, simulator: "Simulator") -> None:
        super().begin(simulator)
        if self._over is not None:
            raise EntryFailed(self._over)
        self.conduct = Conduct()  # what the first step loads is no matter of the race
        self._waited = 0.0

    def _meet(self) -> None:
        await_peer(
            self._endpoint,
            phases.READY,
            timeout=2.0 * self._limits.start_wall,
            poll=self._start.check,
        )

    def _step(self, context: "Context") -> str | None:
        self._began, self._reason = time.monotonic(), None
        self._cpu = self._process.cpu_time()
        self._bus.begin_step()
        self._exchange.send(context)
        try:
            ended = self._exchange.receive(context, stop=self._must_stop)
        except PeerLost:
            ended, self._reason = True, self._late
        self._waited += time.monotonic() - self._began
        violation = self._bus.violation or self._process.excess()
        if self._exchange.waiting > _MOST_WAITING:
            violation = "it sent messages that belong to no step"
        if violation is not None:
            return f"the entry broke the rules: {violation}"
        if ended:
            return self._reason or "the entry left the race"
        spent = self._process.cpu_time() - self._cpu
        self.conduct.steps += 1
        self.conduct.missed_deadlines += spent > self._limits.step_cpu
        self.conduct.longest_step_s = max(self.conduct.longest_step_s, spent)
        self.conduct.cpu_s = self._cpu + spent
        return None

    def _must_stop(self) -> bool:
        """Whether the entry gets no more time for this step; says why in _reason."""
        if self._bus.is_broken or self._process.poll() is not None:
            self._reason = last_words(self._process)
        elif self._process.cpu_time() - self._cpu > self._limits.step_cpu_end:
            self._reason = (
                f"the entry computed {self._limits.step_cpu_end:g} s for one step, and did not end"
            )
        elif self._waited_now() > patient(self._limits.step_wall):
            self._reason = self._late
        elif self._waited + self._waited_now() > patient(self._limits.race_wall):
            self._reason = f"the entry took more than {self._limits.race_wall:g} s for all steps"
        elif excess := self._process.excess():
            self._bus.violation = excess
        return self._reason is not None or self._bus.violation is not None

    def _waited_now(self) -> float:
        return time.monotonic() - self._began


class EntryStart:
    """Watches an entry until it is ready to race, for which nothing that it says gives it longer.

    Attributes:
        process: of the entry.
    """

    def __init__(self, bus: GuardedBus, process: "EntryProcess", limits: "Limits"):
        """From now on its time runs. Args: as meet_entry() has them."""
        self.process, self._bus, self._limits = process, bus, limits
        self._latest = time.monotonic() + patient(limits.start_wall)

    def check(self) -> None:
        """Raises EntryFailed if it has ended, has broken a rule, or has no more time."""
        violation = self._bus.violation or self.process.excess()
        if violation is not None:
            raise EntryFailed(f"the entry broke the rules: {violation}")
        if self.process.poll() is not None or self._bus.is_broken:
            raise EntryFailed(last_words(self.process))
        if time.monotonic() > self._latest:
            raise EntryFailed(
                f"the entry was not ready to race within {self._limits.start_wall:g} s"
            )


def meet_entry(
    scenario: Scenario, bus: GuardedBus, process: "EntryProcess", limits: "Limits"
) -> EntryRemote:
    """Waits until an entry is there, and returns the Remote to race with.

    Args: scenario: the race, as the simulation knows it.

    Raises EntryFailed if it does not come, or asks for what it must not have.
    """
    channels = make_channels(scenario, ())
    bus.allowed = tuple(channel.name for channel in channels if channel.sender == AUTONOMY)
    endpoint = Endpoint(SIMULATION, channels, bus)
    start = EntryStart(bus, process, limits)
    await_peer(endpoint, phases.WAITING, timeout=2.0 * limits.start_wall, poll=start.check)
    wanted = _wanted(endpoint.peer_heartbeat, scenario)
    sent = [
        channel
        for channel in make_channels(scenario, wanted)
        if not channel.ports[0].startswith("truth.")
    ]
    return EntryRemote(sent, endpoint, bus, start, limits)


def _wanted(heartbeat: Any, scenario: Scenario) -> tuple[str, ...]:
    """Returns the optional ports that an entry asks for in a heartbeat."""
    wanted = tuple(heartbeat.value.ports)
    given = [port for port in OPTIONAL_PORTS if port != "state_estimate" or not scenario.localizes]
    for port in wanted:
        if port not in given:
            raise EntryFailed(f"the entry broke the rules: it asked for '{printable(port[:80])}'")
    return wanted


def last_words(process: "EntryProcess") -> str:
    """Returns a clause on why an entry has ended."""
    end = time.monotonic() + patient(_LAST_WORDS)
    while process.poll() is None and time.monotonic() < end:
        time.sleep(0.01)
    process.log.wait()
    lines = process.log.lines
    reason = lines[-1] if lines else f"exit code {process.poll()}"
    return f"the entry was stopped by an error: {reason.removeprefix('airrace: ')[:300]}"
