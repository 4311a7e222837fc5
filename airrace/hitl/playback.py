"""Half an autonomy that flies by messages that are made up: a drone stands before a gate."""

import abc
import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from airrace.diagrams.standing_drone import Standing
from airrace.diagrams.wiring import initial_values
from airrace.hitl.handover import PortValues, Ready, queue_pair
from airrace.hitl.lcm_bridge import navigator_inputs, pilot_inputs
from airrace.hitl.link import phases
from airrace.hitl.link.endpoint import AUTONOMY, SIMULATION, Endpoint
from airrace.hitl.link.simulated_bus import LinkConfig, SimulatedLink
from airrace.hitl.navigator import Navigator
from airrace.hitl.pilot import Halves, Pilot, make_halves

if TYPE_CHECKING:
    from airrace.hitl.channels import PortChannel
    from airrace.scenario import Scenario

LINK = LinkConfig(delay=0.01, jitter=0.0, loss=0.0, seed=0)  # long enough to compensate for
_TICK = 0.001  # s


class Message(NamedTuple):
    """A message of the simulation's."""

    time: float  # simulated, at which it is sent (s)
    channel: str  # its name
    message: Any  # of airrace.lcmtypes


def standing(
    scenario: "Scenario", channels: "Sequence[PortChannel]", duration: float
) -> list[Message]:
    """Returns what the simulation of a drone before a gate would send in a while (s)."""
    values = Standing(scenario, duration)
    messages = [
        Message(
            time,
            channel.name,
            channel.encode(
                lossless=False, **{port: values.of(port, time) for port in channel.ports}
            ),
        )
        for channel in channels
        if channel.sender == SIMULATION and not channel.ports[0].startswith("truth.")
        for time in np.arange(0.0, duration, 1.0 / channel.rate).tolist()
    ]
    return sorted(messages, key=lambda each: each.time)


def made_up_values(scenario: "Scenario", told: dict[str, Any], duration: float) -> list[PortValues]:
    """Returns what the other half of the autonomy of a drone that stands there would say.

    Args: told: name of each port to what it holds at first.
    """
    values, rate = Standing(scenario, duration), scenario.state_estimate.rate
    times = np.arange(0.0, duration, 1.0 / rate).tolist()
    return [
        PortValues(time, {port: values.told(port, first, time) for port, first in told.items()})
        for time in times
    ]


class Playback(abc.ABC):
    """Has half of the real autonomy fly in real time but for the waiting.

    It decodes messages, computes, and sends, to nobody.

    Attributes:
        channels: PortChannels of the race.
    """

    def __init__(self, scenario: "Scenario", halves: Halves, told: dict):
        self._scenario, self._told = scenario, told  # name of a port to what it holds at first
        self.channels = halves.channels(scenario)
        self._link = SimulatedLink(LINK)
        bus, clock = self._link.bus(), self._link.clock
        self._own = Endpoint(AUTONOMY, self.channels, bus, clock)
        self._simulation = Endpoint(SIMULATION, (), self._link.bus(), clock)
        self._here, self._other = queue_pair()

    @abc.abstractmethod
    def _prepare(self) -> bool:
        """Takes in what has come before the start; starts, and returns True, if it is ready."""

    @abc.abstractmethod
    def _step(self) -> object:
        """Works on what has come."""

    def play(self, duration: float) -> np.ndarray:
        """Flies from the start for a while (s), by made-up messages.

        Returns how long this half took for each millisecond (s), (n,).
        """
        messages = standing(self._scenario, self.channels, duration)
        received = made_up_values(self._scenario, self._told, duration)
        first = {each.channel: each for each in reversed(messages)}
        is_ready = False
        while not is_ready:
            self._link.time += _TICK
            if self._simulation.beat(phases.READY, 0.0):
                for each in first.values():
                    self._send(each)
                self._other.send(Ready())
                self._other.send(received[0])
            self._simulation.drain()
            self._own.drain()
            self._own.beat(phases.WAITING, 0.0)
            is_ready = self._prepare()
        start, waiting, words = self._link.time, deque(messages), deque(received)
        spent = np.zeros(round(duration / _TICK))
        for i in range(len(spent)):
            now = (i + 1) * _TICK
            self._link.time = start + now
            while waiting and waiting[0].time <= now:
                self._send(waiting.popleft())
            while words and words[0].time <= now:
                self._other.send(words.popleft())
            self._other.receive()
            self._simulation.beat(phases.RACING, now)
            self._simulation.drain()
            clock = time.perf_counter()
            self._own.drain()
            self._own.beat(phases.RACING, now)
            self._step()
            spent[i] = time.perf_counter() - clock
        return spent

    def _send(self, each):
        self._simulation.publish(each.channel, each.message, each.time)


class PilotPlayback(Playback):
    """Plays to a Pilot."""

    def __init__(self, scenario: "Scenario"):
        """Args: scenario: the race."""
        halves = make_halves(scenario)
        told = pilot_inputs(*halves)
        super().__init__(scenario, halves, initial_values(halves.navigator, halves.pilot, told))
        self._pilot = Pilot(scenario, halves, self._own, self._here)

    def _prepare(self):
        self._pilot.prepare()
        if is_ready := self._pilot.is_ready():
            self._pilot.start()
        return is_ready

    def _step(self):
        self._pilot.step()


class NavigatorPlayback(Playback):
    """Plays to a Navigator."""

    def __init__(self, scenario: "Scenario", output_dir: Path):
        """Args: scenario: the race. output_dir: of the navigator."""
        halves = make_halves(scenario)
        told = navigator_inputs(*halves)
        super().__init__(scenario, halves, initial_values(halves.pilot, halves.navigator, told))
        self._own.only(())  # it beats for the navigator, which listens itself
        self._navigator = Navigator(
            scenario,
            halves,
            self._link.bus(),
            self._here,
            output_dir=output_dir,
            session=self._own.session,
            clock=self._link.clock,
        )

    def _prepare(self):
        self._navigator.step()
        return self._navigator.is_started

    def _step(self):
        self._navigator.step()
