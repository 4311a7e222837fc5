"""How long the ticks of a loop take, counted while it runs."""

import math
import time
from pathlib import Path

from airrace.common.files import write_json

_LEAST, _DECADES, _PER_DECADE = 1e-5, 6, 50  # s; each bin is 5 % longer than the one before


class TickTimes:
    """A histogram of times, in bins that grow evenly by their logarithm, from 10 us to 10 s.

    To add one takes less than a microsecond, so that a control loop may do it at each tick.

    Attributes:
        worst: the longest of all (s).
    """

    def __init__(self) -> None:
        self.worst = 0.0
        self._counts = [0] * (_DECADES * _PER_DECADE + 1)

    def add(self, time: float) -> None:
        """Adds one time (s)."""
        self.worst = max(self.worst, time)
        bin_ = math.ceil(math.log10(max(time, _LEAST) / _LEAST) * _PER_DECADE)
        self._counts[min(bin_, len(self._counts) - 1)] += 1

    def quantile(self, share: float) -> float:
        """Returns the time that a share of all keep (s), at most 5 % too long; NaN for none."""
        wanted, seen = share * sum(self._counts), 0
        for bin_, count in enumerate(self._counts):
            seen += count
            if seen >= wanted and seen:
                return min(_edge(bin_), self.worst)
        return math.nan

    def summary(self) -> dict:
        """Returns plain data: count, median, quantiles and worst (s), and the histogram.

        Each pair of ``histogram`` is the upper edge of a bin (s) and how many were in it.
        """
        return {
            "count": sum(self._counts),
            "median_s": self.quantile(0.5),
            "p99_s": self.quantile(0.99),
            "p99_9_s": self.quantile(0.999),
            "worst_s": self.worst,
            "histogram": [[_edge(b), count] for b, count in enumerate(self._counts) if count],
        }


class LoopTimes:
    """How long the ticks of a loop take: on the wall's clock, and of the processor.

    On a computer that has other work, too, the first says how late a tick ends; the second how
    much of that is its own.
    """

    def __init__(self) -> None:
        self.wall, self.cpu = TickTimes(), TickTimes()
        self.start()

    def start(self) -> None:
        """Begins a tick."""
        self._wall, self._cpu = time.perf_counter(), time.thread_time()

    def stop(self) -> None:
        """Ends a tick that is to be counted."""
        self.wall.add(time.perf_counter() - self._wall)
        self.cpu.add(time.thread_time() - self._cpu)

    def save(self, path: Path) -> None:
        """Writes both summaries as JSON."""
        write_json(path, {"wall": self.wall.summary(), "cpu": self.cpu.summary()})


def _edge(bin_: int) -> float:
    return _LEAST * 10.0 ** (bin_ / _PER_DECADE)
