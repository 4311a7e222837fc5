"""Counts and timing of a channel."""

import numpy as np
import pytest

from airrace.hitl.link.packets import REPLAYED
from airrace.hitl.link.statistics import ChannelStatistics


def statistics_of(times, ages) -> ChannelStatistics:
    """Returns them of messages sent at some times (s), with an age each (s)."""
    statistics, before = ChannelStatistics(), 0
    for number, (time, age) in enumerate(zip(times, ages)):
        missing = max(round((time - before) * 30) - 1, 0) if number else 0
        statistics.add(missing, 100, age, time + age, 0.001)
        before = time
    return statistics


def test_nothing_came():
    statistics = ChannelStatistics()
    assert statistics.loss == 0.0 and set(statistics.timing().values()) == {0.0}


def test_a_steady_channel():
    timing = statistics_of(np.arange(300) / 30, np.full(300, 0.02)).timing()
    assert timing["rate"] == pytest.approx(30.0)
    assert (timing["age_median"], timing["age_p99"], timing["jitter"]) == pytest.approx(
        (0.02, 0.02, 0.0)
    )
    assert (timing["bytes"], timing["decode_time"]) == pytest.approx((100, 0.001))


def test_loss_is_no_jitter():
    rng = np.random.default_rng(0)
    times = np.arange(3000)[rng.random(3000) < 0.5] / 30
    statistics = statistics_of(times, np.full(len(times), 0.02))
    assert statistics.loss == pytest.approx(0.5, abs=0.05)
    assert statistics.timing()["jitter"] == pytest.approx(0.0)


def test_delays_that_differ_are():
    ages = 0.02 + 0.005 * np.random.default_rng(0).uniform(-1, 1, 3000)
    assert statistics_of(np.arange(3000) / 30, ages).timing()["jitter"] == pytest.approx(
        0.005, rel=0.05
    )


def test_who_is_late_is_not_lost():
    statistics = ChannelStatistics()
    for missing in (0, 1, 3):
        statistics.add(missing, 100, 0.0, 0.0, 0.0)
    assert (statistics.lost, statistics.loss) == (4, 4 / 7)
    for _ in range(3):
        statistics.drop(REPLAYED)
    assert (statistics.lost, statistics.loss) == (1, 1 / 7)
    for _ in range(3):  # as often again: a recording
        statistics.drop(REPLAYED)
    assert statistics.loss == 0.0
