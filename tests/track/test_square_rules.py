import copy

import numpy as np
import pytest

from airrace.track import load_track
from airrace.track.generator import generate_square_track
from airrace.track.rules import RuleError
from airrace.track.square_rules import check_square_rules


def course():
    return copy.deepcopy(load_track("grand-prix"))


def moved(track, gate, offset):
    track.gates[gate].position = (track.gates[gate].p_WG + offset).tolist()


def turned(track, gate, degrees):
    track.gates[gate].yaw_deg += degrees


def far_start(track):
    track.start.position = [5.0, 0.0, 0.0]


def pitched(track):
    track.gates[3].pitch_deg = 12.0


def tilted_elsewhere(track):
    track.start.pad_tilt_direction_deg += 90.0


def test_the_shipped_course_is_the_generated_one_and_keeps_all_rules():
    track = course()
    check_square_rules(track)
    made = generate_square_track(1, 17)
    assert (track.start, track.gates) == (made.start, made.gates)


BREAKS = {
    "start": [far_start, tilted_elsewhere],
    "length": [lambda t: moved(t, 16, [-20.0, 0.0, 0.0])],
    "height": [lambda t: moved(t, 10, [0.0, 0.0, 0.8])],
    "slope": [lambda t: moved(t, 1, [0.0, 0.0, 1.2])],
    "facing": [lambda t: turned(t, 16, 40.0)],
    "visibility": [lambda t: turned(t, 8, -34.0)],
    "pitch": [pitched],
}


@pytest.mark.parametrize("rule, change", [(r, c) for r, cs in BREAKS.items() for c in cs])
def test_a_course_that_breaks_a_rule_is_refused(rule, change):
    track = course()
    change(track)
    with pytest.raises(RuleError) as e:
        check_square_rules(track)
    assert e.value.rule == rule


def test_a_course_that_runs_into_itself_is_refused():
    """A square of gates: its legs are all good, but the last one ends on the first."""
    track = course()
    pad = np.array([0.0, 0.0, 0.0])
    corners, p, bearing = [], pad, 0.0
    for length in (9.0, *12 * [9.0]):
        p = p + length * np.array([np.cos(bearing), np.sin(bearing), 0.0])
        corners.append([*p[:2], 2.0])
        bearing += np.deg2rad(45.0)
    track.gates = track.gates[: len(corners)]
    for gate, corner, k in zip(track.gates, corners, range(99)):
        gate.position, gate.yaw_deg, gate.pitch_deg = corner, 45.0 * k + 22.5, 0.0
    track.start.heading_deg = track.start.pad_tilt_direction_deg = 0.0
    with pytest.raises(RuleError) as e:
        check_square_rules(track)
    assert e.value.rule == "clearance"
