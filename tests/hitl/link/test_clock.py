"""What the other side's clocks show, from heartbeats and stamps."""

import types

import pytest

from airrace.hitl.link.clock import PeerClock

OURS, OFFSET = 100.0, 1000.0  # s: our clock starts there, theirs is ahead


def heartbeat(sent, there, back):
    """Ours was sent at a time, arrived, and this one went back (s of our clock)."""
    return types.SimpleNamespace(
        peer_sent=round(sent * 1e9),
        peer_received=round((there + OFFSET) * 1e9),
        sent=round((back + OFFSET) * 1e9),
    )


def test_round_trip_and_offset_come_from_the_quickest_exchange():
    clock = PeerClock()
    assert (clock.round_trip, clock.usual_round_trip, clock.offset) == (0.0, 0.0, 0.0)
    for k in range(20):
        start, late = OURS + k, 0.02 * (k % 4)
        clock.add_heartbeat(heartbeat(start, start + 0.01 + late, start + 0.3), start + 0.31)
    assert clock.round_trip == pytest.approx(0.02, abs=1e-6)
    assert clock.offset == pytest.approx(OFFSET, abs=1e-6)
    assert clock.usual_round_trip == pytest.approx(0.08, abs=1e-6)


def test_a_pause_of_our_own_is_no_delay_of_the_link():
    """All that came meanwhile answers our last, and seems to have come just now."""
    clock = PeerClock()
    for k in range(64):
        start = OURS + 0.05 * k
        clock.add_heartbeat(heartbeat(start, start + 0.02, start + 0.05), start + 0.07)
    last, now = start + 0.05, start + 1.05
    for k in range(20):
        clock.add_heartbeat(heartbeat(last, last + 0.02, last + 0.03 + 0.05 * k), now)
    assert clock.usual_round_trip == pytest.approx(0.04, abs=1e-6)
    assert clock.offset == pytest.approx(OFFSET, abs=1e-6)


def test_what_cannot_be_is_not_taken():
    clock = PeerClock()
    clock.add_heartbeat(types.SimpleNamespace(peer_sent=0, peer_received=0, sent=1), OURS)
    clock.add_heartbeat(heartbeat(OURS + 1.0, OURS + 1.1, OURS + 1.2), OURS)  # of the future
    clock.add_heartbeat(heartbeat(OURS - 50.0, OURS, OURS), OURS)  # of long ago
    assert clock.round_trip == 0.0


@pytest.mark.parametrize("rate", [1.0, 0.25])
def test_simulated_time_by_the_quickest_messages_and_not_far_ahead(rate):
    clock = PeerClock(rate)
    assert clock.sim_time(OURS) == 0.0
    for k in range(200):
        late = 0.004 if k % 3 else 0.0
        clock.add_stamp(rate * 0.005 * k, OURS + 0.005 * k + 0.002 + late)
    now = OURS + 1.0
    assert clock.sim_time(now) == pytest.approx(rate * 0.998, abs=1e-9)
    # The simulation stands still: so does the clock, soon.
    assert clock.sim_time(now + 5.0) <= rate * 0.995 + 0.02


def test_a_simulation_that_falls_behind_is_followed():
    clock = PeerClock()
    for k in range(100):
        clock.add_stamp(0.01 * k, OURS + 0.01 * k)
    for k in range(100, 200):  # 0.3 s late from here on
        clock.add_stamp(0.01 * k, OURS + 0.01 * k + 0.3)
    assert clock.sim_time(OURS + 2.3) == pytest.approx(2.0, abs=0.02)
