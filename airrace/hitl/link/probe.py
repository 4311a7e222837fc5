"""Measures a link before a race: messages like the race's, there and back."""

import dataclasses as dc
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from airrace import lcmtypes
from airrace.hitl.link import image_messages, messages, phases
from airrace.hitl.link.endpoint import AUTONOMY, SIMULATION, Channel, Endpoint
from airrace.hitl.link.lockstep import await_peer
from airrace.hitl.link.packets import MAX_SIZE
from airrace.hitl.link.partners import Partner
from airrace.hitl.link.statistics import ChannelStatistics

if TYPE_CHECKING:
    from airrace.hitl.link.bus import Bus
    from airrace.scenario import Scenario

PICTURE, STATE, COMMAND, STATUS = (
    f"AIRRACE_TEST_{name}" for name in ("PICTURE", "STATE", "COMMAND", "STATUS")
)
CHANNELS = (
    Channel(
        PICTURE,
        lcmtypes.lcmt_pictures,
        SIMULATION,
        image_messages.decode_pictures,
        max_size=MAX_SIZE,
        most_waiting=8,
    ),
    Channel(STATE, lcmtypes.lcmt_rotors, SIMULATION, messages.ROTORS.decode),
    Channel(COMMAND, lcmtypes.lcmt_rotors, AUTONOMY, messages.ROTORS.decode),
    Channel(STATUS, lcmtypes.lcmt_link_status, AUTONOMY, lambda message: message),
)
_STATUS_PERIOD = 0.2  # s
_PAUSE = 1.0  # s, after which another test begins
_DETAIL = 24  # px, of the picture's texture
# Fields of lcmt_link_status, and where the kernel shows them.
_KERNEL_SETTINGS = {
    "receive_buffer": "core/rmem_max",
    "fragment_time": "ipv4/ipfrag_time",
    "fragment_memory": "ipv4/ipfrag_high_thresh",
}


@dc.dataclass(frozen=True)
class LinkFindings:
    """What a test of a link has found."""

    duration: float  # of the test (s)
    # lcmt_link_status, what the autonomy has got, and its kernel's settings
    status: lcmtypes.lcmt_link_status
    commands: ChannelStatistics  # ChannelStatistics of what came back
    ages: np.ndarray  # of the commands: from the state that each answers to its arrival (s)
    round_trip: float  # the quickest heartbeat there and back (s)
    offset: float  # by how much the other computer's clock is ahead (s)
    encode_time: float  # of a picture here (s)
    # picture_rate, state_rate: at which they were sent (Hz)
    picture_rate: float
    state_rate: float

    def received(self, channel: str) -> lcmtypes.lcmt_channel_statistics:
        """Returns what the autonomy has got on a channel."""
        found = (each for each in self.status.channels if each.channel == channel)
        return next(found, lcmtypes.lcmt_channel_statistics())


def measure(
    bus: "Bus",
    scenario: "Scenario",
    duration: float,
    poll: Callable[[], object] = lambda: None,
    show: Callable[[float], object] = lambda share: None,
    patience: float = 60.0,
    me: Partner | None = None,
) -> LinkFindings:
    """Returns how a link does, with an autonomy that waits at its other end.

    Args: poll: called now and then; may raise. show: called with the share of the test that is
    over. patience: how long to wait for the autonomy (s). me: see Endpoint.

    Raises UserError if there is no autonomy.
    """
    endpoint = Endpoint(SIMULATION, CHANNELS, bus, me=me)
    try:
        await_peer(endpoint, phases.TESTING, expected=phases.WAITING, timeout=patience, poll=poll)
        return _Test(endpoint, scenario).run(duration, poll, show)
    finally:
        endpoint.close()


class _Test:
    """Sends what a race sends, and times what comes back."""

    def __init__(self, endpoint: Endpoint, scenario: "Scenario"):
        self._endpoint = endpoint
        self._rates = {PICTURE: scenario.camera.fps, STATE: scenario.controller.rate}
        self._texture = texture(scenario.camera.height, scenario.camera.width)
        self._ages, self._answered, self._encode_time = [], 0, 0.0

    def run(
        self, duration: float, poll: Callable[[], object], show: Callable[[float], object]
    ) -> LinkFindings:
        start = time.monotonic()
        due = dict.fromkeys(self._rates, start)
        while (now := time.monotonic()) < start + duration:
            for channel, rate in self._rates.items():
                if now >= due[channel]:
                    due[channel] = max(due[channel] + 1.0 / rate, now - 0.1)
                    self._send(channel, now)
            if self._endpoint.beat(phases.TESTING, now):
                poll()
                show((now - start) / duration)
            self._receive(min(due.values()) - time.monotonic())
        end = now + 2 * _STATUS_PERIOD  # what is still on its way
        while time.monotonic() < end:
            self._receive(0.01)
        return self._findings(duration)

    def _send(self, channel, now):
        if channel == STATE:
            message = messages.ROTORS.encode(np.array([now]))
        else:
            clock = time.perf_counter()
            shifted = np.roll(self._texture, self._endpoint.sequence(PICTURE), axis=1)
            pictures = {image_messages.GREY: shifted}
            message = image_messages.encode_pictures(pictures, now, lossless=False)
            self._encode_time += time.perf_counter() - clock
        self._endpoint.publish(channel, message, now)

    def _receive(self, timeout):
        self._endpoint.wait(timeout)
        self._endpoint.drain()
        answer = self._endpoint.newest(COMMAND)
        if answer is not None and answer.stamp.sequence != self._answered:
            self._answered = answer.stamp.sequence
            self._ages.append(answer.arrival - float(answer.value[0]))

    def _findings(self, duration):
        endpoint = self._endpoint
        status = endpoint.newest(STATUS)
        pictures = endpoint.sequence(PICTURE)
        return LinkFindings(
            duration=duration,
            status=status.value if status else lcmtypes.lcmt_link_status(),
            commands=endpoint.statistics[COMMAND],
            ages=np.array(self._ages),
            round_trip=endpoint.clock.round_trip,
            offset=endpoint.clock.offset,
            encode_time=self._encode_time / max(pictures, 1),
            picture_rate=pictures / duration,
            state_rate=endpoint.sequence(STATE) / duration,
        )


def texture(height: int, width: int) -> np.ndarray:
    """Returns a picture that is as hard to compress as the camera's, (h, w) uint8."""
    noise = np.random.Generator(np.random.PCG64(0))
    coarse = noise.integers(40, 215, (height // _DETAIL + 1, width // _DETAIL + 1), np.uint8)
    picture = np.kron(coarse, np.ones((_DETAIL, _DETAIL), np.uint8))[:height, :width]
    return (picture + noise.integers(-4, 5, picture.shape)).astype(np.uint8)


class Responder:
    """The autonomy's part of a test."""

    def __init__(self, endpoint: Endpoint):
        """Args: endpoint: of the autonomy, which receives on CHANNELS."""
        self._endpoint = endpoint
        self._answered = (0, 0)
        self._last, self._status_sent = -np.inf, 0.0

    def respond(self) -> None:
        """Answers what has come since the last call."""
        received = self._endpoint.newest(STATE)
        if received is None:
            return
        mark = (received.stamp.session, received.stamp.sequence)
        now, sim_time = time.monotonic(), received.stamp.time
        if mark != self._answered:
            self._answered, self._last = mark, now
            self._endpoint.publish(COMMAND, messages.ROTORS.encode(received.value), sim_time)
        if now - self._last < _PAUSE and now - self._status_sent > _STATUS_PERIOD:
            self._status_sent = now
            self._endpoint.publish(STATUS, self._status(), sim_time)

    def _status(self):
        message = lcmtypes.lcmt_link_status()
        for name, path in _KERNEL_SETTINGS.items():
            setattr(message, name, _kernel_setting(path))
        for channel in (PICTURE, STATE):
            statistics = self._endpoint.statistics[channel]
            each = lcmtypes.lcmt_channel_statistics()
            each.channel, each.received = channel, statistics.received
            each.missing, each.dropped = statistics.lost, statistics.dropped.total()
            for name, value in statistics.timing().items():
                setattr(each, name, value)
            message.channels.append(each)
        message.num_channels = len(message.channels)
        return message


def _kernel_setting(path: str) -> int:
    """Returns a number that the kernel's networking works by, 0 if unknown."""
    try:
        return int(Path("/proc/sys/net", path).read_text(encoding="ascii"))
    except (OSError, ValueError):
        return 0
