"""The rules are written down here a second time, plainly, for what is generated."""

import dataclasses as dc
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.common.yaml import yaml_dump_typed

from airrace.common.errors import UserError
from airrace.track import generator, load_track
from airrace.track.generator import generate_square_track, generate_track
from airrace.track.geometry import segment_distances
from airrace.track.hall import Hall
from airrace.track.rules import RuleError, check_rules
from airrace.track.square_rules import check_square_rules
from airrace.track.square_track import SquareTrack

seeds = st.integers(0, 2**40)


def segment_distance(a, b):
    """Returns the distance of two segments, pairs of end points."""
    return segment_distances(*np.transpose([a, b], (1, 0, 2)))[0, 1]


counts = st.sampled_from([8, 10, 12, 14, 16, 18, 20])
ways = st.sampled_from(["left", "right"])
square_counts = st.one_of(st.none(), st.integers(2, 20))


def following(gates):
    return zip(gates, gates[1:] + gates[:1])


@pytest.mark.slow
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
    tracks = [generate_track(seed) for seed in range(50)]
    lengths = np.array([len(track.gates) for track in tracks])
    assert set(lengths) == {8, 10, 12, 14, 16, 18, 20}
    assert len({track.name.rpartition("-")[2] for track in tracks}) == 2


@pytest.mark.slow
@given(seeds)
@settings(max_examples=4)
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


def degrees_between(a, b):
    return abs((a - b + 180.0) % 360.0 - 180.0)


def bearings(legs):
    return np.rad2deg(np.arctan2(legs[:, 1], legs[:, 0]))


def flat_distance(p, a, b):
    """Distance on the ground plan of points, (n, 2), from a segment."""
    t = np.clip((p - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
    return np.linalg.norm(p - (a + t[:, None] * (b - a)), axis=1)


@settings(max_examples=25)
@given(seeds, square_counts)
def test_generated_courses(seed, count):
    track = generate_square_track(seed, count)
    track.check()
    check_square_rules(track)
    assert len(track.gates) == count or (count is None and 17 <= len(track.gates) <= 20)
    assert not track.closed and track.surroundings == "hall"
    start = track.start
    assert start.pad_tilt_deg == 17.8 and start.pad_tilt_direction_deg == start.heading_deg
    way = np.array([start.position, *(gate.position for gate in track.gates)])
    legs = np.diff(way, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    assert np.all((8.0 - 2e-3 <= lengths[1:]) & (lengths[1:] <= 15.0 + 2e-3))
    if len(track.gates) >= 17:
        assert 185.0 <= lengths.sum() <= 215.0
    assert np.all((1.6 - 1e-3 <= way[1:, 2]) & (way[1:, 2] <= 6.0 + 1e-3))
    slopes = np.rad2deg(np.arcsin(legs[1:, 2] / lengths[1:]))
    assert np.all((-10.2 <= slopes) & (slopes <= 16.2))
    ways = bearings(legs)
    assert degrees_between(ways[0], start.heading_deg) <= 10.2
    for bearing, after in itertools.pairwise(ways):
        assert degrees_between(bearing, after) <= 50.2
    for gate, leading, following in zip(track.gates, ways, [*ways[1:], None]):
        assert degrees_between(leading, gate.yaw_deg) <= 35.2
        assert following is None or degrees_between(following, gate.yaw_deg) <= 35.2
        assert abs(gate.pitch_deg) <= 10.0
    # Legs that do not meet keep apart; points every 10 cm.
    points = [
        a + np.linspace(0, 1, 150)[:, None] * (b - a) for a, b in itertools.pairwise(way[:, :2])
    ]
    for i, j in itertools.combinations(range(len(legs)), 2):
        if j > i + 1:
            assert flat_distance(points[i], *way[j : j + 2, :2]).min() >= 4.5 - 2e-3


@settings(max_examples=10)
@given(seeds)
def test_straight_courses_hardly_turn(seed):
    track = generate_square_track(seed, straight=True)
    check_square_rules(track)
    legs = np.diff([gate.position for gate in track.gates], axis=0)
    assert len(track.gates) == 6 and np.abs(legs[:, 2]).max() < 0.5
    turns = [degrees_between(a, b) for a, b in itertools.pairwise(bearings(legs))]
    assert max(turns) <= 4.1


def test_courses_wind_climb_and_descend():
    tracks = [generate_square_track(seed) for seed in range(20)]
    assert {len(track.gates) for track in tracks} == {17, 18, 19, 20}
    turns, rises = [], []
    for track in tracks:
        legs = np.diff([gate.position for gate in track.gates], axis=0)
        turns += ((np.diff(bearings(legs)) + 180) % 360 - 180).tolist()
        rises += legs[:, 2].tolist()
    assert np.mean(np.array(turns) > 10) > 0.2 and np.mean(np.array(turns) < -10) > 0.2
    assert np.mean(np.array(rises) > 0.5) > 0.2 and np.mean(np.array(rises) < -0.5) > 0.2


def test_the_same_arguments_give_the_same_course_and_file(tmp_path):
    track = generate_square_track(7)
    assert track == generate_square_track(7) != generate_square_track(8)
    path = tmp_path / "course.yaml"
    path.write_text(yaml_dump_typed(track, schema=SquareTrack))
    assert load_track(str(path)) == track


@pytest.mark.parametrize("seed, gates", [(-1, None), (0, 1), (0, 21)])
def test_what_no_course_fits_is_refused(seed, gates):
    with pytest.raises(UserError, match="give 0 or more" if seed < 0 else "give 2 to 20"):
        generate_square_track(seed, gates)


@settings(max_examples=10)
@given(seeds)
def test_the_hall_has_room_around_the_course(seed):
    track = generate_square_track(seed)
    hall = track.hall()
    assert isinstance(hall, Hall)
    points = track.outline()
    assert np.all(points[:, :2] >= hall.low[:2] + 8.0) and np.all(
        points[:, :2] <= hall.high[:2] - 8.0
    )
    assert np.all(points[:, 2] <= hall.high[2] - 4.0) and hall.low[2] == 0.0
    way = np.array([track.start.position, *(gate.position for gate in track.gates)])[:, :2]
    for column in hall.columns:
        p = column.X_WB.translation()[None, :2]
        assert min(flat_distance(p, a, b)[0] for a, b in itertools.pairwise(way)) >= 4.0 - 1e-9
        assert column.size[2] == hall.high[2]
    assert len(hall.lights) > 20
    for light in hall.lights:
        top = light.X_WB.translation()[2] + light.size[2] / 2
        assert top == hall.high[2]
