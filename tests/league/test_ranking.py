"""The ranking: what counts, in which order, and that luck counts little."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.evaluation.summary import wilson_interval
from airrace.league.ranking import rank, round_down


def flights(entry, laps):
    """Lines of league.json; laps: (s) by race, None for one that was not finished."""
    return [
        {
            "entry": entry,
            "leg": leg,
            "finished": lap is not None,
            "mean_lap_s": lap,
            "best_lap_s": lap and lap - 0.5,
        }
        for leg, lap in enumerate(laps, 1)
    ]


def test_finishing_comes_before_speed():
    lines = flights("gambler", 10 * [8.0] + 10 * [None]) + flights("steady", 20 * [12.0])
    first, second = rank(["gambler", "steady"], lines, 0.05)
    assert (first.entry, first.place, first.finished) == ("steady", 1, 20)
    assert (second.entry, second.place, second.best_lap_s) == ("gambler", 2, 7.5)


def test_within_a_step_the_mean_lap_decides():
    lines = flights("slow", 20 * [12.0]) + flights("quick", 19 * [11.0] + [None])
    assert rank(["slow", "quick"], lines, 0.5)[0].entry == "quick"
    assert rank(["slow", "quick"], lines, 0.01)[0].entry == "slow"


def test_laps_are_compared_on_the_same_races():
    """Who failed on the slow track is no quicker for that."""
    lines = flights("a", [10.0, 30.0, 10.0]) + flights("b", [11.0, None, 11.0])
    a, b = rank(["a", "b"], lines, 1.0)
    assert (a.entry, a.mean_lap_s, a.common) == ("a", 10.0, 2)
    assert (b.entry, b.mean_lap_s, b.common) == ("b", 11.0, 2)


def test_without_a_common_race_its_own_count():
    lines = flights("a", [10.0, None]) + flights("b", [None, 9.0])
    b, a = rank(["a", "b"], lines, 1.0)
    assert (b.entry, b.mean_lap_s, a.mean_lap_s) == ("b", 9.0, 10.0)


def test_equal_ones_share_a_place_and_who_never_finished_is_last():
    lines = flights("c", [10.0]) + flights("b", [10.0]) + flights("a", [None])
    places = [(each.place, each.entry) for each in rank(["a", "b", "c"], lines, 1.0)]
    assert places == [(1, "b"), (1, "c"), (3, "a")]


def test_who_has_not_flown_yet():
    (only,) = rank(["a"], [], 0.05)
    assert (only.place, only.races, only.mean_lap_s, only.best_lap_s) == (1, 0, None, None)


@given(
    data=st.lists(st.lists(st.none() | st.floats(5.0, 50.0), min_size=4, max_size=4), max_size=5),
    step=st.sampled_from([0.01, 0.05, 0.25, 1.0]),
)
def test_laws(data, step):
    """The order of entries and lines does not matter; the lower end of the interval does."""
    names = [f"e{i}" for i in range(len(data))]
    lines = [line for name, laps in zip(names, data) for line in flights(name, laps)]
    standings = rank(names, lines, step)
    assert rank(names[::-1], lines[::-1], step) == standings
    assert [each.step for each in standings] == sorted((e.step for e in standings), reverse=True)
    for each in standings:
        low, high = wilson_interval(each.finished, each.races)
        assert (each.rate_low, each.rate_high) == (low, high)
        assert each.step <= low + 1e-8 and low < each.step + step


@pytest.mark.parametrize("rate, step, expected", [(0.3, 0.1, 0.3), (0.29, 0.1, 0.2), (0, 0.05, 0)])
def test_round_down(rate, step, expected):
    assert round_down(rate, step) == pytest.approx(expected)
