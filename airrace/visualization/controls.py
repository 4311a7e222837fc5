"""How fast a race is simulated, as people ask for it on its page."""

import threading
import time
from collections.abc import Callable
from typing import NamedTuple

from pydrake.systems.analysis import Simulator

MAX_RATE = 100.0  # x real time
_NAP = 0.05  # s


class Wish(NamedTuple):
    """What was asked for: to pause, and a rate (x real time, 0 = as fast as it can)."""

    paused: bool = False
    rate: float = 0.0


class Wishes:
    """What people ask for on a page; its server writes it, and the race reads it."""

    def __init__(self) -> None:
        """Begins without a race that could be steered."""
        self._lock = threading.Lock()
        self._now: Wish | None = None

    @property
    def now(self) -> Wish | None:
        """The latest Wish; None if nothing can be asked for."""
        return self._now

    def begin(self, rate: float) -> None:
        """Allows wishes; rate: that the race begins with (x real time, 0 = as fast as it can)."""
        self._now = Wish(rate=rate)

    def end(self) -> None:
        """Allows none any more."""
        with self._lock:
            self._now = None

    def ask(self, message: object) -> None:
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
    """Steers a Simulator as people wish.

    Only how fast a race is simulated changes, never what happens in it.
    """

    def __init__(self, wishes: Wishes, simulator: Simulator):
        """Args: wishes: of the page. simulator: of the race."""
        self._wishes, self._simulator = wishes, simulator
        self._rate = simulator.get_target_realtime_rate()
        wishes.begin(self._rate)

    def steer(self, interrupted: Callable[[], bool] = lambda: False) -> None:
        """Does what was asked for; while the race is paused, waits.

        Args:
            interrupted: whether to give up waiting.
        """
        paused = False
        while (wish := self._wishes.now) and wish.paused and not interrupted():
            paused = True
            time.sleep(_NAP)
        if wish and wish.rate != self._rate:
            self._rate = wish.rate
            self._simulator.set_target_realtime_rate(wish.rate)
        elif not paused:
            return
        # It would hurry to make up for the time before.
        self._simulator.ResetStatistics()
