"""Estimates of the other side's clocks, from the time stamps of its messages."""

import collections
import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from airrace.lcmtypes import lcmt_heartbeat

_WINDOW = 0.5  # s, in which the quickest message tells the time
_MOST_AHEAD = 0.015  # s, beyond the newest stamp: a side that sends nothing may stand still
_EXCHANGES = 64  # heartbeats of which the quickest counts


class PeerClock:
    """What the other side's clocks show.

    There are two: the simulated time, which may stand still or run slowly, and the clock
    of the computer. Each heartbeat says when the one that it answers was sent and how long
    the answer took, as in NTP (RFC 5905): this gives the round trip, and if both directions
    take the same time, the offset between the computers' clocks. Of all heartbeats
    that answer the same one of ours, the quickest counts: those that arrive while
    this process pauses seem to have taken as long as the pause.
    """

    def __init__(self, rate: float = 1.0):
        """Args: rate: how fast the simulated time goes, at most."""
        self.rate = rate
        self._stamps = collections.deque()  # (arrival, simulated time - rate arrival), s
        self._newest = -math.inf
        self._exchanges = collections.deque(maxlen=_EXCHANGES)  # (round trip, offset), s
        self._answered = -math.inf  # when we sent what the newest exchange began with, s

    def add_heartbeat(self, heartbeat: "lcmt_heartbeat", arrival: float) -> None:
        """Takes a heartbeat that came at a time of our computer's clock (s)."""
        if heartbeat.peer_sent <= 0:
            return
        sent, back = heartbeat.peer_sent * 1e-9, heartbeat.sent * 1e-9
        there = heartbeat.peer_received * 1e-9
        round_trip = (arrival - sent) - (back - there)
        if not 0.0 <= round_trip < 10.0:
            return
        exchange = round_trip, ((there - sent) + (back - arrival)) / 2
        if sent == self._answered:
            exchange = min(exchange, self._exchanges.pop())
        self._exchanges.append(exchange)
        self._answered = sent

    def add_stamp(self, sim_time: float, arrival: float) -> None:
        """Takes the simulated time at which a message was sent, and when it came (s)."""
        self._newest = max(self._newest, sim_time)
        offset = sim_time - self.rate * arrival
        # Only what could yet be the quickest stays.
        while self._stamps and self._stamps[-1][1] <= offset:
            self._stamps.pop()
        self._stamps.append((arrival, offset))

    def restart(self) -> None:
        """Forgets the simulated time: it stood still, and begins to run."""
        self._stamps.clear()

    @property
    def round_trip(self) -> float:
        """The quickest of late (s); 0 before there was any."""
        return min(self._exchanges)[0] if self._exchanges else 0.0

    @property
    def usual_round_trip(self) -> float:
        """Nine of ten of late were quicker (s); 0 before there was any."""
        trips = sorted(trip for trip, _ in self._exchanges)
        return trips[9 * len(trips) // 10] if trips else 0.0

    @property
    def offset(self) -> float:
        """By how much the other computer's clock is ahead of ours (s)."""
        return min(self._exchanges)[1] if self._exchanges else 0.0

    def sim_time(self, now: float) -> float:
        """Returns the simulated time that shows at a time of our computer's clock (s).

        That is without the time that messages take. It runs on between messages, but
        not for long: without messages it is unknown whether it still runs.
        """
        while len(self._stamps) > 1 and self._stamps[0][0] < now - _WINDOW:
            self._stamps.popleft()
        if not self._stamps:
            return 0.0
        return min(self.rate * now + self._stamps[0][1], self._newest + _MOST_AHEAD)

    def age(self, sim_time: float, arrival: float) -> float:
        """Returns how long before it came a message was sent (s), by simulated time."""
        return max(self.sim_time(arrival) - sim_time, 0.0) + self.rate * self.round_trip / 2
