"""An autonomy that flies by messages of a race that nobody flies: recorded, or made up."""

import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from airrace.diagrams.autonomy_process import AutonomyProcess
from airrace.hitl.link import phases
from airrace.hitl.link.endpoint import SIMULATION, Endpoint
from airrace.hitl.link.simulated_bus import LinkConfig, SimulatedLink

if TYPE_CHECKING:
    from airrace.scenario import Scenario

LINK = LinkConfig(delay=0.01, jitter=0.0, loss=0.0, seed=0)  # long enough to compensate for
_TICK = 0.001  # s


class Message(NamedTuple):
    """A message of the simulation's.

    Attributes:
        time: simulated, at which it is sent (s).
        channel: its name.
        message: of airrace.lcmtypes.
    """

    time: float
    channel: str
    message: Any


class Playback:
    """Has the real autonomy fly by given messages, as in a race in real time but for the waiting.

    It decodes them, computes, and sends its commands, which nobody obeys.

    Attributes:
        channels: PortChannels of the race.
    """

    def __init__(self, scenario: "Scenario", output_dir: Path):
        """Constructs it.

        Args:
            scenario: the race.
            output_dir: of the autonomy.
        """
        self._link = SimulatedLink(LINK)
        clock = self._link.clock
        self._autonomy = AutonomyProcess(scenario, self._link.bus(), output_dir, clock=clock)
        self._autonomy.build(lossless=False)
        self.channels = self._autonomy.channels
        self._endpoint = Endpoint(SIMULATION, (), self._link.bus(), clock)

    def play(self, messages: Sequence[Message], duration: float) -> np.ndarray:
        """Flies for a while from the start.

        Args:
            messages: in the order of their times, at least one of each channel.
            duration: (s).

        Returns:
            how long the autonomy took for each millisecond (s), (n,).
        """
        first = {each.channel: each for each in reversed(messages)}
        while not self._autonomy.is_ready():
            self._link.time += _TICK
            if self._endpoint.beat(phases.READY, 0.0):
                for each in first.values():
                    self._send(each)
            self._endpoint.drain()
            self._autonomy.poll_link(phases.WAITING)
        self._autonomy.start()
        start, waiting = self._link.time, deque(messages)
        spent = np.zeros(round(duration / _TICK))
        for i in range(len(spent)):
            now = (i + 1) * _TICK
            self._link.time = start + now
            while waiting and waiting[0].time <= now:
                self._send(waiting.popleft())
            self._endpoint.beat(phases.RACING, now)
            self._endpoint.drain()
            clock = time.perf_counter()
            self._autonomy.poll_link(phases.RACING)
            self._autonomy.step()
            spent[i] = time.perf_counter() - clock
        return spent

    def _send(self, each):
        self._endpoint.publish(each.channel, each.message, each.time)
