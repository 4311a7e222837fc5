"""The rules are written down here a second time, plainly, for what is generated."""

import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from airrace.common.errors import UserError
from airrace.track import generator
from airrace.track.generator import generate_track
from airrace.track.geometry import segment_distances
from airrace.track.rules import RuleError, check_rules

seeds = st.integers(0, 2**40)


def segment_distance(a, b):
    """Returns the distance of two segments, pairs of end points."""
    return segment_distances(*np.transpose([a, b], (1, 0, 2)))[0, 1]


counts = st.sampled_from([8, 10, 12, 14, 16, 18, 20])
ways = st.sampled_from(["left", "right"])


def following(gates):
    return zip(gates, gates[1:] + gates[:1])


@pytest.mark.slow
@settings(max_examples=60)
@given(seeds, counts, ways)
def test_generated_tracks(seed, count, direction):
    track = generate_track(seed, count, direction)
    track.check()
    check_rules(track)
    assert len(track.gates) == count
    turns = []
    for gate, after in following(track.gates):
        ahead = after.p_WL - gate.p_WL
        assert abs(ahead @ gate.rightward) < 2e-3
        assert 12.0 - 2e-3 <= ahead @ gate.forward <= 70.0 + 2e-3
        turns.append((after.heading_deg - gate.heading_deg + 180) % 360 - 180)
        assert after.pylon_spacing == 10.0
    assert set(turns) <= {45.0, -45.0}
    assert sum(turns) == (360.0 if direction == "left" else -360.0)
    start = track.start
    to_gate = track.gates[0].p_WG - start.position
    assert 10.0 - 1e-2 <= to_gate @ track.gates[0].forward <= 25.0 + 1e-2
    assert 4.0 <= track.hover_height <= 6.0
    assert 0.0 <= start.pad_tilt_deg <= 10.0
    assert 0.0 <= start.heading_deg < 360.0 and 0.0 <= start.pad_tilt_direction_deg < 360.0


@settings(max_examples=10)
@given(seeds, counts, ways)
def test_legs_have_room(seed, count, direction):
    gates = generate_track(seed, count, direction).gates
    legs = [(a.p_WG[:2], b.p_WG[:2]) for a, b in following(gates)]
    for i, leg in enumerate(legs):
        for j, gate in enumerate(gates):
            if j not in (i, (i + 1) % count):
                for pylon in (gate.p_WL[:2], gate.p_WR[:2]):
                    assert segment_distance(leg, (pylon, pylon)) > 5.99
        for j in range(i + 2, count - (i == 0)):
            assert segment_distance(leg, legs[j]) > 9.99


@pytest.mark.slow
def test_every_seed_gives_a_track():
    """`python -m benchmarks.tracks` does this with a thousand."""
    tracks = [generate_track(seed) for seed in range(100)]
    lengths = np.array([len(track.gates) for track in tracks])
    assert set(lengths) == {8, 10, 12, 14, 16, 18, 20}
    assert len({track.name.rpartition("-")[2] for track in tracks}) == 2


@pytest.mark.slow
@given(seeds)
@settings(max_examples=10)
def test_the_same_seed_gives_the_same_track(seed):
    track = generate_track(seed)
    assert track == generate_track(seed)
    direction = track.name.rpartition("-")[2]
    assert track == generate_track(seed, len(track.gates), direction)
    other = generate_track(seed + 1, len(track.gates), direction)
    assert track.gates != dc.replace(other, name=track.name).gates


@pytest.mark.parametrize("count", [9, 19, 6, -2, 21, 22])
def test_numbers_of_gates_that_cannot_be_closed(count):
    with pytest.raises(UserError, match=f"{count} gates: .* even number, 8 at least, and 20 are"):
        generate_track(0, count)


def test_other_bad_arguments():
    with pytest.raises(UserError, match="seed cannot be negative"):
        generate_track(-1)
    with pytest.raises(UserError, match="direction 'up'"):
        generate_track(0, 10, "up")


def test_a_seed_without_a_track_is_refused_with_the_reason(monkeypatch):
    def never(layout):
        raise RuleError("visibility", "it is foggy")

    monkeypatch.setattr(generator, "_LAYOUTS", 20)
    monkeypatch.setattr(generator, "check_visibility", never)
    with pytest.raises(
        UserError,
        match="Seed 3 gives no track of 8 gates to the left: of 20 "
        r"layouts \d+ broke the rule on visibility; take another seed",
    ):
        generate_track(3, 8, "left")


def test_a_start_without_room_is_drawn_again(monkeypatch):
    """Layouts whose every start is unfair are given up, and say so."""
    monkeypatch.setattr(generator, "_LAYOUTS", 40)
    monkeypatch.setattr(generator, "START_DISTANCE", (40.0, 50.0))
    with pytest.raises(UserError, match="rule on"):
        generate_track(3, 8, "left")
