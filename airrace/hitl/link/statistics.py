"""What came on a channel, counted and timed."""

import collections

import numpy as np

from airrace.hitl.link.packets import REPLAYED

_TIMING = ("rate", "jitter", "age_median", "age_p99", "bytes", "decode_time")
_RECENT = 4096  # messages that the timing is of


class ChannelStatistics:
    """Counts of one channel, and timing of its recent messages.

    Attributes:
        received: messages that were used.
        missing: messages that should have come, by the sequence numbers, when a later one did.
        dropped: reason (see packets.py) to count.
    """

    def __init__(self) -> None:
        self.received = self.missing = 0
        self.dropped = collections.Counter()
        # Arrival (s), age (s), size (bytes), time of decoding (s).
        self._recent = collections.deque(maxlen=_RECENT)

    def drop(self, reason: str) -> None:
        """Counts a message that is not used."""
        self.dropped[reason] += 1

    def add(self, missing: int, size: int, age: float, arrival: float, decoding: float) -> None:
        """Counts a message, and those between the one before and it that did not come.

        Args:
            missing: how many these are.
            size: of the message (bytes).
            age, arrival: when it came (s): its age, and by our clock.
            decoding: time that took (s).
        """
        self.received += 1
        self.missing += missing
        self._recent.append((arrival, age, size, decoding))

    @property
    def lost(self) -> int:
        """Number of messages that never came; one that came after a later one is not lost."""
        return max(self.missing - self.dropped[REPLAYED], 0)

    @property
    def loss(self) -> float:
        """Share of the messages that never came."""
        return self.lost / max(self.missing + self.received, 1)

    def summary(self) -> dict:
        """Returns counts and timing, for race.json."""
        counts = {"received": self.received, "missing": self.missing}
        return {**counts, "dropped": dict(self.dropped), **self.timing()}

    def timing(self) -> dict:
        """Returns rate (Hz), jitter, age_median, age_p99, decode_time (s), bytes.

        ``jitter`` is the 99th percentile of how far an age is from their median: the delay
        variation of RFC 5481, about the median. Messages that are lost do not add to it.
        """
        if len(self._recent) < 2:
            return dict.fromkeys(_TIMING, 0.0)
        arrival, age, size, decoding = np.array(self._recent).T
        median, age_p99 = np.percentile(age, (50, 99))
        rate = (len(arrival) - 1) / max(arrival[-1] - arrival[0], 1e-9)
        jitter = np.percentile(np.abs(age - median), 99)
        numbers = rate, jitter, median, age_p99, size.mean(), decoding.mean()
        return dict(zip(_TIMING, map(float, numbers)))
