import numpy as np
import pytest

from airrace.analysis.course_report import passages
from airrace.track.square_gate import SquareGate
from airrace.track.square_track import SquareTrack

TRACK = SquareTrack("three", gates=[SquareGate([x, 0.0, 2.0], 0.0) for x in (10.0, 20.0, 30.0)])


def flown(*points, speed=2.0):
    """Rows of time, position and velocity along straight lines from point to point."""
    rows, time = [], 5.0
    for a, b in zip(np.array(points, float), np.array(points[1:], float)):
        length = np.linalg.norm(b - a)
        for share in np.arange(0.0, 1.0, 0.05 / length):
            rows.append(
                [time + share * length / speed, *a + share * (b - a), *speed * (b - a) / length]
            )
        time += length / speed
    return np.array(rows)


def test_a_gate_that_was_passed_says_where():
    first, *_ = passages(TRACK, flown((0, 0, 2), (12, 0.24, 2.36)), 1)
    assert first.counted and first.what == "passed" and first.time == pytest.approx(10.0, abs=0.05)
    assert (first.right, first.up) == (pytest.approx(-0.2), pytest.approx(0.3))
    assert first.speed == pytest.approx(2.0)


@pytest.mark.parametrize(
    "place, words",
    [
        ((10.0, 0.0, 3.2), "missed: 0.45 m above the opening, on the frame"),
        ((10.0, -2.0, 2.0), "missed: 1.25 m to the right of the opening"),
        ((10.0, 1.0, 0.5), "missed: 0.75 m below and 0.25 m to the left of the opening"),
        ((10.0, 0.1, 2.1), "missed: through the opening, out of order or from behind"),
    ],
)
def test_a_gate_that_was_missed_says_by_how_much(place, words):
    x, y, z = place
    first, *_ = passages(TRACK, flown((8, y, z), (12, y, z)), 0)
    assert first.what == words and not first.counted


def test_a_gate_that_was_not_reached_says_how_far_it_was():
    *_, last = passages(TRACK, flown((0, 0, 2), (25, 0, 2)), 2)
    assert last.what.startswith("not reached: 5.") and last.what.endswith("at 17.5 s")
    assert np.isnan(last.time)
    (first, *_) = passages(TRACK, np.empty((0, 7)), 0)
    assert first.what == "never flown to"


def test_gates_are_looked_for_in_their_order():
    """The second time through the second gate does not count for the first lap's time."""
    path = flown((0, 0, 2), (35, 0, 2))
    times = [passage.time for passage in passages(TRACK, path, 3)]
    assert times == pytest.approx([10.0, 15.0, 20.0], abs=0.05)
