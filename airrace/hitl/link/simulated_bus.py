"""A link whose delay, jitter, loss and cuts are declared: the same every time."""

import dataclasses as dc
import heapq
import itertools

from airrace.hitl.link.bus import Bus
from airrace.math.random import make_generator


@dc.dataclass
class LinkConfig:
    """What a simulated link does to messages, each way."""

    delay: float = 0.0  # s
    jitter: float = 0.0  # s, of the delay, evenly on both sides: messages overtake each other
    loss: float = 0.0  # share of the packets
    cuts: tuple = ()  # pairs: from when to when nothing gets through (s)
    packet: int = 1472  # bytes; a message that loses one packet of it is lost
    seed: int = 0


class SimulatedLink:
    """Joins SimulatedBuses; its time is what is set.

    Attributes:
        time: (s).
    """

    def __init__(self, config: LinkConfig):
        """Args: config: of the link."""
        self.time = 0.0
        self._config = config
        self._noise = make_generator(config.seed, "link")
        self._buses = []
        self._order = itertools.count()

    def clock(self) -> float:
        """Returns the time (s); for an Endpoint."""
        return self.time

    def bus(self) -> "SimulatedBus":
        """Returns one more computer's end of the link."""
        self._buses.append(SimulatedBus(self))
        return self._buses[-1]

    def send(self, channel: str, data: bytes) -> None:
        """Brings a message to all, or loses it."""
        config = self._config
        packets = -(-len(data) // config.packet)
        # Drawn whether or not they matter, so that a cut changes nothing else.
        lost = self._noise.random() > (1.0 - config.loss) ** packets
        delay = config.delay + config.jitter * self._noise.uniform(-1.0, 1.0)
        if lost or any(start <= self.time < end for start, end in config.cuts):
            return
        message = self.time + max(delay, 0.0), next(self._order), channel, data
        for bus in self._buses:
            bus.enqueue(message)


class SimulatedBus(Bus):
    """One computer's end of a link: what has arrived lies here until it is handed over."""

    def __init__(self, link: SimulatedLink):
        """See SimulatedLink.bus()."""
        super().__init__()
        self._link = link
        self._messages = []  # a heap of (arrival, order, channel, data)

    def enqueue(self, message: tuple) -> None:
        """Takes a message that is under way: (arrival, order, channel, data)."""
        if self.hears(message[2]):
            heapq.heappush(self._messages, message)

    def publish(self, channel: str, data: bytes) -> None:
        """Sends a message, or loses it."""
        self._link.send(channel, data)

    def hand_over(self) -> bool:
        if not self._messages or self._messages[0][0] > self._link.time:
            return False
        _, _, channel, data = heapq.heappop(self._messages)
        self._take(channel, data)
        return True
