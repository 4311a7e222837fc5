"""The pace of a race's simulation, as its pages ask for it."""

import threading
import time
from collections.abc import Callable
from typing import NamedTuple

from pydrake.systems.analysis import Simulator

MAX_RATE = 100.0  # x real time
_NAP = 0.05  # s


class Pace(NamedTuple):
    """Whether the simulation pauses, and its rate (x real time, 0 = as fast as it can)."""

    paused: bool = False
    rate: float = 0.0


class PaceRequest:
    """The pace that pages ask for: their server writes it, and the race reads it."""

    def __init__(self) -> None:
        """Begins without a race whose pace could be set."""
        self._lock = threading.Lock()
        self._now: Pace | None = None

    @property
    def now(self) -> Pace | None:
        """The latest request; None if the pace cannot be set."""
        return self._now

    def begin(self, rate: float) -> None:
        """Allows requests; rate: that the race begins with (x real time, 0 = as fast as it can)."""
        self._now = Pace(rate=rate)

    def end(self) -> None:
        """Allows none any more."""
        with self._lock:
            self._now = None

    def receive(self, message: object) -> None:
        """Takes in a page's message: a dict with ``pause``, ``rate``, or both.

        What makes no sense is left out: anybody can send anything.
        """
        if not isinstance(message, dict):
            return
        pause, rate = message.get("pause"), message.get("rate")
        with self._lock:
            if self._now is None:
                return
            if isinstance(pause, bool):
                self._now = self._now._replace(paused=pause)
            if isinstance(rate, (int, float)) and rate is not True and 0.0 <= rate <= MAX_RATE:
                self._now = self._now._replace(rate=float(rate))


class RaceControls:
    """Gives a Simulator the pace that is asked for.

    Only how fast a race is simulated changes, never what happens in it.
    """

    def __init__(self, request: PaceRequest, simulator: Simulator):
        """Args: request: of the page. simulator: of the race."""
        self._request, self._simulator = request, simulator
        self._rate = simulator.get_target_realtime_rate()
        request.begin(self._rate)

    def steer(self, interrupted: Callable[[], bool] = lambda: False) -> None:
        """Sets the pace; while the race is paused, waits.

        Args:
            interrupted: whether to give up waiting.
        """
        paused = False
        while (pace := self._request.now) and pace.paused and not interrupted():
            paused = True
            time.sleep(_NAP)
        if pace and pace.rate != self._rate:
            self._rate = pace.rate
            self._simulator.set_target_realtime_rate(pace.rate)
        elif not paused:
            return
        # It would hurry to make up for the time before.
        self._simulator.ResetStatistics()
