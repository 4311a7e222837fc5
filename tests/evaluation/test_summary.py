import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.evaluation.summary import dnf_class, race_line, summarize, wilson_interval
from tests.evaluation.rows import row


class TestWilsonInterval:
    @pytest.mark.parametrize(
        "successes, trials, low, high",
        [
            # Newcombe, Statistics in Medicine 17 (1998), 857-872, table I, method 3.
            (81, 263, 0.2553, 0.3662),
            (15, 148, 0.0624, 0.1605),
            (0, 20, 0.0, 0.1611),
            (1, 29, 0.0061, 0.1718),
        ],
    )
    def test_published_values(self, successes, trials, low, high):
        assert wilson_interval(successes, trials) == pytest.approx((low, high), abs=5e-5)

    @given(trials=st.integers(1, 10**6), data=st.data())
    def test_solves_the_score_equation(self, trials, data):
        """At its ends, the rate seen is z standard deviations off."""
        successes = data.draw(st.integers(0, trials))
        rate, z = successes / trials, 1.959963984540054
        low, high = wilson_interval(successes, trials)
        assert 0.0 <= low <= rate <= high <= 1.0
        for end in (low, high):
            assert (rate - end) ** 2 == pytest.approx(
                z**2 * end * (1 - end) / trials, rel=1e-6, abs=1e-12
            )
        mirrored = wilson_interval(trials - successes, trials)
        assert mirrored == pytest.approx((1 - high, 1 - low))

    def test_nothing_is_known_without_trials(self):
        assert wilson_interval(0, 0) == (0.0, 1.0)


def test_numbers_of_races():
    rows = [
        row(0),
        row(1, finished=False, laps=(30.0,), reason="touched pylon_3_left", collisions=1),
        row(2, finished=False, laps=(), explored=False),
        row(3, finished=False, laps=(), reason="touched pylon_12_right", collisions=1),
    ]
    summary = summarize([race_line(r) for r in rows])
    assert (summary["races"], summary["finished"], summary["explored"]) == (4, 1, 3)
    assert summary["finish_rate"] == 0.25
    assert summary["finish_rate_95"] == list(wilson_interval(1, 4))
    # Only closed loops count as explored; their times are 70, 71 and 73 s.
    assert summary["exploration_s"] == {
        "n": 3,
        "mean": pytest.approx(214 / 3),
        "median": 71.0,
        "min": 70.0,
        "max": 73.0,
    }
    # All complete laps count, also of races that did not finish.
    assert summary["lap_s"]["n"] == 3 and summary["lap_s"]["max"] == 30.0
    assert summary["lap_speed"]["max"] == 400.0 / 20.0
    # Of the last lap.
    assert summary["map_rms_m"] == {
        "n": 2,
        "mean": 0.015,
        "median": 0.015,
        "min": 0.01,
        "max": 0.02,
    }
    assert summary["collisions"] == 2
    assert list(summary["dnf_reasons"].items()) == [("touched a pylon", 2), ("ran out of time", 1)]


def test_no_races():
    summary = summarize([])
    assert summary["finish_rate"] is None and summary["lap_s"] is None
    assert summary["dnf_reasons"] == {}


def test_no_wall_time_reaches_the_numbers():
    slow = row(0)
    slow["wall"] = {"seconds": 1e9, "real_time_factor": 1e-9}
    assert race_line(slow) == race_line(row(0))
    assert all(math.isfinite(v) for v in race_line(slow)["lap_times_s"])


def test_classes_of_reasons():
    assert dnf_class("touched board_17 after rotor 3 had failed") == (
        "touched a board after rotor 3 had failed"
    )
    lost = "the drone gave up at 23.6 s (no marker was where it should be in 90 pictures)"
    assert dnf_class(lost) == "the drone gave up (no marker was where it should be)"
    lost = "the drone gave up at 9.6 s (velocity uncertain by 5.1 m/s after 7.0 s without"
    assert dnf_class(lost) == "the drone gave up (velocity uncertain without"
    assert dnf_class("hit the ground") == "hit the ground"
