"""One side's end of the link: sends messages, and keeps the newest valid one of each channel."""

import collections
import contextlib
import dataclasses as dc
import os
import time
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from airrace.hitl.link import packets
from airrace.hitl.link.bus import Bus, Subscription
from airrace.hitl.link.clock import PeerClock
from airrace.hitl.link.partners import AUTONOMY as AUTONOMY
from airrace.hitl.link.partners import SIMULATION as SIMULATION
from airrace.hitl.link.partners import Partner, Partners
from airrace.hitl.link.statistics import ChannelStatistics
from airrace.lcmtypes import lcmt_heartbeat

HEARTBEAT = "AIRRACE_HEARTBEAT"
HEARTBEAT_PERIOD = 0.05  # s
_LAST_HEARTBEATS = 5
# The loopback of this computer alone. Whoever wants more says so.
DEFAULT_URL = "udpm://239.255.76.67:7667?ttl=0"
_QUEUE = 4000  # messages that wait for their time at most
_MOST_AHEAD = 1_000_000  # of the sequence number, beyond which it is made up
_LONG_AGO = 1.0  # s, by which a message may be sent before the newest and still count
_OLD_ECHO = 3.0  # s, age of the heartbeat of ours that a new session answers
_DOUBT = 0.3  # s of silence, after which another session may be the other side
_DRAINING = 0.2  # s that drain() takes at most, if it can choose: messages may come without an end


@dc.dataclass(frozen=True)
class Channel:
    """What an endpoint must know of a channel to receive on it."""

    name: str  # of the channel
    message_type: type  # of airrace.lcmtypes
    sender: str  # the role that sends on it, "simulation" or "autonomy"
    decode: Callable[[Any], Any]  # from a message to a value; may raise Dropped
    timed: bool = False  # whether what comes early waits until the time of its stamp
    max_size: int = 1 << 20  # of a message (bytes)
    most_waiting: int = 100  # messages that wait to be received, the newest
    # Whether what waits is decoded at all if a newer message is there, which passes the same checks
    newest_wins: bool = False


@dc.dataclass(frozen=True)
class Received:
    """A value that came: with its Stamp, and when, by the endpoint's clock (s)."""

    value: Any
    stamp: packets.Stamp
    arrival: float


class _Arrived(NamedTuple):
    """A message that is not decoded yet."""

    channel: Channel
    data: bytes
    stamp: packets.Stamp
    arrival: float  # by the endpoint's clock (s)
    missing: int  # messages between the one before and it that have not come


# What is heard before the first: infinitely long ago, of no phase, and saying nothing.
_NO_HEARTBEAT = Received(lcmt_heartbeat(), packets.Stamp(0, 0, 0.0), float("-inf"))


class Endpoint:
    """Sends and receives for one of the two roles."""

    def __init__(
        self,
        role: str,
        channels: Iterable[Channel],
        bus: Bus,
        clock: Callable[[], float] = time.monotonic,
        session: int | None = None,
        me: Partner | None = None,
    ):
        """Constructs the endpoint, which listens from now on.

        Args:
            channels: all Channels of the link; it receives on those of the other side.
            bus: to the other side.
            session: of another endpoint with the same role and clock that speaks for this one,
                too: it sends the heartbeats, and neither sends on a channel of the other's.
            me: what the heartbeats say of this side; None: of no race, and any other side will do.
        """
        self.role = role
        self.session = session or int.from_bytes(os.urandom(7)) | 1
        self.peer = 0  # session of the other side, 0 while unknown
        self.peer_heartbeat = _NO_HEARTBEAT  # the newest
        self._stranger = None  # Received, a heartbeat of another session that may be let in
        self.partners = Partners(role, me or Partner())
        self.clock = PeerClock()
        self.statistics = {}  # name of a channel to ChannelStatistics
        self._bus = bus
        self.now = clock
        self._sequences = {}  # of what was sent, by channel
        self._last = {}  # sequence of what was received, by channel
        self._newest = {}  # Received by channel
        self._sim_time = float("inf")  # as newest() was last asked
        self._early = {}  # deque of Received by channel
        self._newest_time = -1.0
        self._keep: Callable[[str, Received], object] | None = None
        self._is_known: Callable[[str, int], bool] = lambda channel, sequence: False
        self._beaten = float("-inf")  # when beat() last sent, s
        self._waiting: dict[str, _Arrived] = {}  # what is to be decoded
        self._subscriptions: dict[str, Subscription] = {}  # by channel
        for channel in channels:
            if channel.sender != role:
                self._subscribe(channel)
        self._subscribe(Channel(HEARTBEAT, lcmt_heartbeat, "", lambda message: message))

    def _subscribe(self, channel: Channel) -> None:
        self.statistics[channel.name] = ChannelStatistics()
        self._subscriptions[channel.name] = self._bus.subscribe(
            channel.name,
            lambda _, data: self._receive(channel, data),
            max_size=channel.max_size,
            most_waiting=channel.most_waiting,
        )

    def only(self, channels: Iterable[str]) -> None:
        """Receives nothing any more but heartbeats, and what comes on some channels, by name."""
        for name in self._subscriptions.keys() - {HEARTBEAT, *channels}:
            self._bus.unsubscribe(self._subscriptions.pop(name))

    def close(self) -> None:
        """Receives nothing any more."""
        for subscription in self._subscriptions.values():
            self._bus.unsubscribe(subscription)
        self._subscriptions.clear()

    def publish(self, channel: str, message: Any, sim_time: float) -> bytes:
        """Sends a message, stamped with a simulated time (s); returns its bytes."""
        sequence = self._sequences.get(channel, 0) + 1
        self._sequences[channel] = sequence
        data = packets.pack(message, packets.Stamp(self.session, sequence, sim_time))
        self.republish(channel, data)
        return data

    def republish(self, channel: str, data: bytes) -> None:
        """Sends the bytes of publish() once more."""
        # A cable that is pulled takes its routes along: lost, as anything on a bad link.
        with contextlib.suppress(OSError):
            self._bus.publish(channel, data)

    def sequence(self, channel: str) -> int:
        """Returns the sequence number of what was last sent on a channel, 0 if nothing was."""
        return self._sequences.get(channel, 0)

    def send_heartbeat(
        self,
        phase: str,
        sim_time: float,
        text: str = "",
        step: int = 0,
        belongs: dict | None = None,
    ) -> bytes:
        """Sends a heartbeat; see lcmt_heartbeat. ``belongs``: channel to sequence number."""
        message = lcmt_heartbeat()
        self.partners.phase = phase
        self.partners.introduce(message, self.now())
        message.text, message.step = text, step
        message.sent = round(self.now() * 1e9)
        heard = self.peer_heartbeat
        if self._stranger is not None and self.silence > _DOUBT:
            heard, self._stranger = self._stranger, None
        if heard is not _NO_HEARTBEAT:
            message.peer, message.peer_sent = heard.stamp.session, heard.value.sent
            message.peer_received = round(heard.arrival * 1e9)
        belongs = belongs or {}
        message.num_channels = len(belongs)
        message.channels, message.sequences = list(belongs), list(belongs.values())
        return self.publish(HEARTBEAT, message, sim_time)

    def join(self, race: str) -> None:
        """Is of a race from now on, and forgets an other side that is not."""
        self.partners.me.race = race
        if self.peer and self.peer_heartbeat.value.race != race:
            self.peer, self.peer_heartbeat = 0, _NO_HEARTBEAT

    def beat(self, phase: str, sim_time: float, text: str = "") -> bool:
        """Sends a heartbeat if it is time for one; returns whether it was."""
        if self.now() - self._beaten < HEARTBEAT_PERIOD:
            return False
        self._beaten = self.now()
        self.send_heartbeat(phase, sim_time, text)
        return True

    def wait(self, timeout: float) -> None:
        """Waits until there is something to drain, at most some time (s)."""
        if timeout > 0.0:
            self._bus.wait(timeout)

    def drain(self) -> None:
        """Receives the messages that wait, the oldest first. Never raises.

        It ends although some still wait when it has taken too long: where decoding takes longer
        than the other side takes to send, there would be no end, and nothing else had a turn.
        """
        end = self.now() + _DRAINING
        while self._bus.hand_over() and self.now() < end:
            pass
        while self._waiting:
            self._decode(self._waiting.popitem()[1])

    def keep_all(
        self, keep: Callable[[str, Received], object], is_known: Callable[[str, int], bool]
    ) -> None:
        """From now on hands every valid message to keep(channel, received), in any order.

        A message of which is_known(channel, sequence number) is true was kept before: it is not
        decoded again, which may take longer than until its next copy comes.
        """
        self._keep, self._is_known = keep, is_known

    def say_last(self, phase: str, sim_time: float, text: str = "") -> None:
        """Sends a heartbeat after which no other may come, so often that one arrives."""
        for _ in range(_LAST_HEARTBEATS):
            self.send_heartbeat(phase, sim_time, text)

    def summary(self) -> dict:
        """Returns counts and timing of all channels, and counts of datagrams, for race.json."""
        channels = {name: each.summary() for name, each in self.statistics.items()}
        return {"channels": channels, "datagrams": self._bus.summary()}

    def show(self, channel: str, received: Received) -> None:
        """Makes something that was kept the newest on its channel."""
        self._newest[channel] = received

    def newest(self, channel: str, sim_time: float = float("inf")) -> Received | None:
        """Returns the newest valid value on a channel, None before the first.

        Args: sim_time: of now (s): on a timed channel, later stamps do not count yet.
        """
        early, self._sim_time = self._early.get(channel), sim_time
        while early and early[0].stamp.time <= sim_time:
            self._newest[channel] = early.popleft()
        return self._newest.get(channel)

    @property
    def silence(self) -> float:
        """Time since the other side's last heartbeat (s); infinite before the first."""
        return self.now() - self.peer_heartbeat.arrival

    def _receive(self, channel: Channel, data: bytes) -> None:
        """Checks what has come as far as that is quick, and decodes it, now or after the others."""
        arrival, statistics = self.now(), self.statistics[channel.name]
        try:
            stamp = packets.stamp_of(data)
            if channel.name == HEARTBEAT:
                message = packets.decode(data, channel.message_type)
                if stamp.session not in (self.session, self.peer):
                    self.partners.notice(message, arrival)
                if message.role == self.role:
                    return  # our own, or of a second process with this role
                self._check_heartbeat(message, stamp, arrival)
            last = self._check(channel.name, stamp)
            if channel.timed and stamp.time > self._sim_time + _LONG_AGO:
                raise packets.Dropped(packets.MALFORMED)  # it would block all others
        except packets.Dropped as e:
            statistics.drop(e.args[0])
            return
        missing = max(stamp.sequence - last - 1, 0) if last else 0
        arrived = _Arrived(channel, data, stamp, arrival, missing)
        if not channel.newest_wins or self._keep is not None:
            self._decode(arrived)
            return
        if channel.name in self._waiting:
            statistics.drop(packets.OVERTAKEN)
        self._waiting[channel.name] = arrived

    def _decode(self, arrived: "_Arrived") -> None:
        channel, data, stamp, arrival, missing = arrived
        clock, statistics = time.perf_counter(), self.statistics[channel.name]
        try:
            if stamp.session != self.peer:  # any more
                raise packets.Dropped(packets.FOREIGN)
            value = channel.decode(packets.decode(data, channel.message_type))
        except packets.Dropped as e:
            statistics.drop(e.args[0])
            return
        except (Exception, SystemExit):  # Drake's assertions become SystemExit
            statistics.drop(packets.MALFORMED)
            return
        self._last[channel.name] = max(self._last.get(channel.name, 0), stamp.sequence)
        self._newest_time = max(self._newest_time, stamp.time)
        received = Received(value, stamp, arrival)
        if self._keep is None and channel.timed:
            waiting = self._early.setdefault(channel.name, collections.deque(maxlen=_QUEUE))
            waiting.append(received)
        elif self._keep is None:
            self._newest[channel.name] = received
        else:
            self._keep(channel.name, received)
        if channel.name == HEARTBEAT:
            self.peer_heartbeat = received
            self.clock.add_heartbeat(value, arrival)
        self.clock.add_stamp(stamp.time, arrival)
        decoding = time.perf_counter() - clock
        age = self.clock.age(stamp.time, arrival)
        statistics.add(missing, len(data), age, arrival, decoding)

    def _check(self, name: str, stamp: packets.Stamp) -> int:
        """Returns the sequence number before on the channel; raises Dropped."""
        if stamp.session != self.peer:
            raise packets.Dropped(packets.FOREIGN)
        waiting, last = self._waiting.get(name), self._last.get(name, 0)
        last = max(last, waiting.stamp.sequence) if waiting else last
        replayed = self._keep is None or self._is_known(name, stamp.sequence)
        if stamp.sequence <= last and replayed:
            raise packets.Dropped(packets.REPLAYED)
        if stamp.sequence > last + _MOST_AHEAD:
            raise packets.Dropped(packets.MALFORMED)
        if stamp.time < self._newest_time - _LONG_AGO:
            raise packets.Dropped(packets.STALE)
        return last

    def _check_heartbeat(self, message, stamp, arrival):
        """Accepts a new session of the other side, if it proves that it is live.

        The proof is that it has just received a heartbeat of ours: a recording of an earlier
        run names another session of ours, one of this run an old time. A process that has
        received none yet is answered by our next heartbeat, unless the known other side is
        alive. See also Partners.admits(). Raises Dropped.
        """
        if stamp.session == self.peer:
            return
        if not self.partners.admits(message):
            raise packets.Dropped(packets.FOREIGN)
        fresh = 0.0 <= arrival - message.peer_sent * 1e-9 < _OLD_ECHO
        if message.peer != self.session or not fresh:
            self._stranger = Received(message, stamp, arrival)
        if message.peer != self.session or not fresh or self.silence < _DOUBT:
            raise packets.Dropped(packets.FOREIGN)
        self.peer = stamp.session
        self._last.clear()
        self._newest_time = -1.0
        self.clock = PeerClock(self.clock.rate)
