"""A histogram that knows its quantiles within 5 %."""

import json
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.common.tick_times import LoopTimes, TickTimes


@given(st.lists(st.floats(1e-5, 9.0), min_size=1), st.floats(0.01, 1.0))
def test_quantiles_are_those_of_the_times(times, share):
    ticks = TickTimes()
    for each in times:
        ticks.add(each)
    true = np.sort(times)[max(int(np.ceil(share * len(times) - 1e-9)) - 1, 0)]
    assert true * (1 - 1e-9) <= ticks.quantile(share) <= true * 1.05
    assert ticks.worst == max(times)


def test_the_summary_is_plain_data():
    ticks = TickTimes()
    assert np.isnan(ticks.quantile(0.5))
    for each in (0.0, 1e-3, 1e-3, 50.0):
        ticks.add(each)
    summary = ticks.summary()
    assert summary["count"] == 4 and summary["worst_s"] == 50.0
    assert summary["median_s"] == pytest.approx(1e-3, rel=0.05)
    assert [count for _, count in summary["histogram"]] == [1, 2, 1]


def test_a_pause_takes_time_but_not_of_the_processor(tmp_path):
    ticks = LoopTimes()
    ticks.start()
    time.sleep(0.02)
    ticks.stop()
    ticks.save(tmp_path / "ticks.json")
    saved = json.loads((tmp_path / "ticks.json").read_text())
    assert saved["wall"]["worst_s"] >= 0.02 > saved["cpu"]["worst_s"]
