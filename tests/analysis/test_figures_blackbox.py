"""What a flight controller logged, in the report."""

import numpy as np
import pandas as pd
import pytest

from airrace.analysis import figures_blackbox, load_run
from airrace.analysis.blackbox import FILE, RACE_BEGINS
from airrace.analysis.figures_blackbox import delay, rates_figure, read_log
from airrace.analysis.report import make_report
from tests.analysis.test_blackbox import make_log
from tests.worlds.made_up_run import make_run

LAG = 0.04  # s


@pytest.fixture
def run(tmp_path):
    return load_run(make_run(tmp_path / "run", laps=1))


@pytest.fixture
def log():
    time = np.arange(0.0, 12.0, 0.004)
    fields = {"time": time}
    for axis in range(3):
        fields[f"setpoint[{axis}]"] = 100.0 * np.sin((3 + axis) * time)
        fields[f"gyroADC[{axis}]"] = 100.0 * np.sin((3 + axis) * (time - LAG))
    return pd.DataFrame(fields | {f"motor[{i}]": np.full(len(time), 1500.0) for i in range(4)})


def test_a_delay_is_found(log):
    assert [delay(log, axis) for axis in range(3)] == pytest.approx(3 * [LAG], abs=0.002)


def test_the_picture_is_of_the_busiest_seconds(run, log):
    log.loc[log["time"] < 2.9, "setpoint[0]"] = 0.0
    figure = rates_figure(run, log)
    begin, end = figure.axes[-1].lines[0].get_xdata()[[0, -1]]
    assert begin >= 2.8 and end - begin == pytest.approx(4.0, abs=0.01)
    assert "40 ms behind" in figure.axes[1].get_title(loc="right")


def test_of_a_race_with_laps_the_picture_is_of_these(run, log):
    first, last = run.lap_starts
    log.loc[~log["time"].between(first, last), "setpoint[0]"] *= 50.0  # as at its take-off
    plots = rates_figure(run, log).axes
    assert first <= plots[-1].lines[0].get_xdata()[0] <= last
    assert [line.get_label() for line in plots[-1].lines] == [f"motor {i}" for i in range(1, 5)]
    assert len({tuple(line.get_color()) for line in plots[-1].lines}) == 4


def test_a_report_has_it_only_with_a_log_that_can_be_read(run, log, monkeypatch):
    assert read_log(run) is None and "<h2>Betaflight</h2>" not in make_report(run)
    (run.folder / FILE).write_bytes(b"damaged")
    assert read_log(run) is None
    (run.folder / FILE).write_bytes(make_log()[0])  # of a flight that was over before the race
    assert RACE_BEGINS > 3.0 and read_log(run) is None
    monkeypatch.setattr(figures_blackbox, "RACE_BEGINS", 0.0)
    assert read_log(run) is None  # it has neither set-points nor gyroscope
    monkeypatch.setattr(figures_blackbox, "read_log", lambda run: log)
    assert "<h2>Betaflight</h2>" in make_report(run)
