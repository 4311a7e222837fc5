"""What the referee reports."""

import dataclasses as dc

from airrace.common.immutable import Immutable

OUT_OF_TIME = "ran out of time"
# Why a race ended; the index into this tuple is the referee's verdict.
VERDICTS = (
    None,
    "finished",
    "hit the ground",
    "touched {what}",
    "left the arena",
    OUT_OF_TIME,
    "the simulation failed",
)
FINISHED, GROUND, TOUCHED, ARENA, TIMEOUT, DIVERGED = range(1, 7)


@dc.dataclass(frozen=True)
class GateCrossing:
    """One gate flown through in order.

    Attributes:
        time: of the crossing, interpolated between two looks (s).
        gate: number of the gate, from 1.
        lap: number of the lap that this crossing belongs to, from 1; gate 1
            belongs to the lap that it starts.
        offset: distance of the crossing from the gate's midpoint (m).
        max_speed: since the crossing before (m/s).
    """

    time: float
    gate: int
    lap: int
    offset: float
    max_speed: float


@dc.dataclass(frozen=True)
class RefereeStatus(Immutable):
    """The race so far.

    Attributes:
        crossings: all counted crossings in order; the one after the last
            lap's last gate closes that lap.
        finished: whether all laps are flown.
        dnf_reason: why the race ended before that, or None.
        end_time: of either (s), or None.
        collisions: number of contacts that the race ended with (0 or 1).
    """

    crossings: tuple
    finished: bool
    dnf_reason: str | None
    end_time: float | None
    collisions: int

    @property
    def over(self) -> bool:
        """Whether the race has ended."""
        return self.end_time is not None
