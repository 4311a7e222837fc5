"""Two processes tick by tick: what one computes never depends on how fast the other is."""

import heapq
import itertools
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from airrace.common.errors import UserError
from airrace.common.patience import VARIABLE, patient
from airrace.hitl.link import phases
from airrace.hitl.link.endpoint import HEARTBEAT, HEARTBEAT_PERIOD, Endpoint
from airrace.hitl.link.link_key import UNSIGNED
from airrace.hitl.link.packets import MALFORMED

if TYPE_CHECKING:
    from pydrake.systems.framework import Context

    from airrace.hitl.lcm_sender import LcmSender
    from airrace.hitl.received_ports import LcmReceiver
    from airrace.scenario import Scenario

_RESEND = 0.05  # s without an answer, after which the last messages are sent again
_LONGEST_PAUSE = 2.0  # s; from one time to the next, the pause doubles
_PATIENCE = 120.0  # s: planning a lap takes its time
# Ticks that the other side may be ahead, at least, and messages that wait for theirs, at most: more
# are of nobody who keeps to the exchange.
_AHEAD, _MOST_WAITING = 2, 64


class PeerLost(Exception):
    """The other side does not answer any more; the argument says since when (s)."""


def lockstep_times(scenario: "Scenario", poll_period: float) -> Iterator[float]:
    """Yields all times (s), from 0, at which one side may need what the other one has.

    That is whenever a system of either side has an update. The arithmetic is Drake's,
    so that times are equal to the last bit. A system of the user's with another period
    sees values that are at most one step of the plant old.

    Args: poll_period: between two polls of the race (s).
    """
    s, frame, latency = scenario, 1.0 / scenario.camera.fps, scenario.camera.resolved().latency
    periods = {(s.plant_config.time_step, 0.0), (poll_period, 0.0)}
    periods |= {(frame, after) for after in (0.0, latency, s.perception.latency + latency)}
    sampled = s.rotors, s.imu, s.state_estimate, s.referee, s.explorer, s.planner
    reacting = s.state_filter, s.rotor_monitor, s.controller
    periods |= {(1.0 / system.rate, 0.0) for system in (*sampled, *reacting)}

    def events(period, offset):  # as Drake has them
        return (offset + k * period for k in itertools.count())

    for now, _ in itertools.groupby(heapq.merge(*itertools.starmap(events, periods))):
        yield now


class Exchange:
    """Exchanges the messages of one tick after the other."""

    def __init__(self, endpoint: Endpoint, receiver: "LcmReceiver", sender: "LcmSender"):
        """Constructs the exchange, at no tick yet; the endpoint takes messages in any order now."""
        self._endpoint, self._receiver, self._sender = endpoint, receiver, sender
        self._sent = self._received = 0  # ticks
        self._sequences = {}  # of what was sent so far, by channel
        self._outgoing = ([], [])  # channels and bytes of the last two ticks
        self._asked, self._pause = 0.0, _RESEND  # when they were last sent, until the next time (s)
        self._pending = {}  # (channel, sequence) to Received
        self._beats = {}  # tick to heartbeat
        self._used = {}  # channel to sequence
        endpoint.keep_all(self._keep, self._is_known)

    @property
    def waiting(self) -> int:
        """Number of messages that were kept, and belong to no tick so far."""
        return len(self._pending) + len(self._beats)

    def _is_known(self, channel, sequence):
        if channel == HEARTBEAT:
            return False
        used = self._used.get(channel, 0)
        return sequence <= used or (channel, sequence) in self._pending

    def _keep(self, channel, received):
        if channel != HEARTBEAT:
            self._pending[channel, received.stamp.sequence] = received
            if len(self._pending) > _MOST_WAITING:
                del self._pending[next(iter(self._pending))]  # if it was true, it comes again
        elif 0 < received.value.step <= self._received + _AHEAD:
            self._beats[received.value.step] = received.value

    def send(self, root_context: "Context") -> None:
        """Sends what changed, as the next tick."""
        self._sent += 1
        self._asked, self._pause = self._endpoint.now(), _RESEND
        sent = self._sender.send(root_context)
        for channel, _ in sent:
            self._sequences[channel] = self._endpoint.sequence(channel)
        beat = self._endpoint.send_heartbeat(
            phases.RACING, root_context.get_time(), step=self._sent, belongs=self._sequences
        )
        self._outgoing = (self._outgoing[1], [*sent, (HEARTBEAT, beat)])

    def receive(
        self,
        root_context: "Context",
        stop: Callable[[], bool] = lambda: False,
        poll: Callable[[], object] = lambda: None,
    ) -> bool:
        """Waits for the other side's tick, and shows what it brought.

        Returns whether the other side has ended the race, or stop() was true; it calls poll()
        meanwhile. Raises PeerLost if it does not answer.
        """
        start = self._endpoint.now()
        tick = self._received + 1
        while True:
            self._endpoint.drain()
            if self._is_complete(tick):
                break
            now = self._endpoint.now()
            if self._endpoint.peer_heartbeat.value.phase == phases.OVER or stop():
                return True
            if now - start > patient(_PATIENCE):
                raise PeerLost(now - start)
            if now - self._asked > self._pause:
                # The other side may only be slow: the more copies, the longer it takes.
                self._asked, self._pause = now, min(2.0 * self._pause, _LONGEST_PAUSE)
                for channel, data in (*self._outgoing[0], *self._outgoing[1]):
                    self._endpoint.republish(channel, data)
            poll()
            self._endpoint.wait(_RESEND)
        self._received = tick
        beat = self._beats.pop(tick)
        for channel, sequence in zip(beat.channels, beat.sequences):
            if self._used.get(channel) != sequence:
                self._used[channel] = sequence
                self._endpoint.show(channel, self._pending.pop((channel, sequence)))
        self._receiver.receive(root_context, self._endpoint)
        for stale in [key for key in self._pending if key[1] <= self._used.get(key[0], 0)]:
            del self._pending[stale]
        for old in [old for old in self._beats if old < tick]:
            del self._beats[old]
        return False

    def _is_complete(self, tick: int) -> bool:
        beat = self._beats.get(tick)
        if beat is None or len({*beat.channels}) < len(beat.channels):
            return False
        return all(
            self._used.get(channel) == sequence or (channel, sequence) in self._pending
            for channel, sequence in zip(beat.channels, beat.sequences)
        )


def await_peer(
    endpoint: Endpoint,
    phase: str,
    *,
    expected: str | None = None,
    timeout: float,
    poll: Callable[[], object] = lambda: None,
) -> None:
    """Sends heartbeats until the other side is in a phase.

    Args:
        expected: phase of the other side; None: the same.
        timeout: (s), since a doctor was last there, or the autonomy last said that it compiles;
            patient() makes it longer.
        poll: called now and then; may raise.

    Raises UserError if it does not come, if there is another race, or if the other side has
    another scenario or another airrace.
    """
    timeout = patient(timeout)
    start = endpoint.now()
    while True:
        now = endpoint.now()
        endpoint.beat(phase, 0.0)
        endpoint.wait(HEARTBEAT_PERIOD / 5)
        endpoint.drain()
        poll()
        heard = endpoint.peer_heartbeat
        if endpoint.silence < 1.0:
            if heard.value.phase == (expected or phase):
                # The echo of what was heard: until it comes, the other side drops all we send.
                endpoint.send_heartbeat(phase, 0.0)
                return
            if heard.value.phase in (phases.TESTING, phases.COMPILING):
                start = now  # which may take longer than this side waits
        if endpoint.peer == 0 and (objection := endpoint.partners.objection(endpoint.now())):
            endpoint.say_last(phase, 0.0)  # so that the other side knows why, too
            raise UserError(objection)
        if now - start > timeout:
            raise UserError(_in_vain(endpoint, timeout))


def _in_vain(endpoint: Endpoint, timeout: float) -> str:
    """Returns a sentence on why the other side has not come within a time (s)."""
    other, heard = endpoint.partners.other, endpoint.peer_heartbeat.value
    slow = f"For a slow computer, set {VARIABLE}."
    if endpoint.silence < 1.0:
        what = f"{heard.phase}: {heard.text}" if heard.text else heard.phase
        return (
            f"The {other} runs, but does not get ready within {timeout:.0f} s: it says "
            f"{what[:200]}; see what it prints. {slow}"
        )
    if endpoint.statistics[HEARTBEAT].dropped[MALFORMED]:
        return (
            f"No {other} answered within {timeout:.0f} s, but something at this --lcm_url sends "
            "heartbeats of another airrace: give both sides the same version."
        )
    if UNSIGNED in endpoint.summary()["datagrams"].get("dropped", {}):
        return (
            f"No {other} answered within {timeout:.0f} s, but something at this --lcm_url sends "
            "what is not signed with this --link_key: give both sides the same file."
        )
    return (
        f"No {other} answered within {timeout:.0f} s: check that it runs, that both have "
        "the same --lcm_url (ttl=1 between two computers), the cable, the multicast route "
        f"and the firewall; airrace doctor --link tells more. {slow}"
    )
