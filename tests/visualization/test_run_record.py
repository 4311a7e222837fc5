"""A run's record is what the page would have been told while it was flown."""

import base64

import cv2
import numpy as np
import pytest

from airrace.analysis import load_run
from airrace.diagrams.race import run_race
from airrace.scenario import load_scenario
from airrace.track import load_track
from airrace.vehicle import GRAVITY
from airrace.visualization.live_page import LivePage
from airrace.visualization.race_record import FRAME
from airrace.visualization.run_record import poses_at, record_of
from tests.worlds.made_up_run import FIRST, GATES, LAP, flight, make_run


def frames(batch):
    rows = np.frombuffer(base64.b64decode(batch["frames"]), "<f4").reshape(-1, len(FRAME))
    return dict(zip(FRAME, rows.T))


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return load_run(make_run(tmp_path_factory.mktemp("run") / "run", laps=2))


def test_the_drone_is_where_it_was(run):
    made = frames(record_of(run).whole())
    p = np.column_stack([made[axis] for axis in "xyz"])
    expected = np.array([flight(time)[0] for time in made["time"]])
    np.testing.assert_allclose(p, expected, atol=0.01)
    assert np.diff(made["time"]).max() < 0.05
    assert made["time"][-1] == pytest.approx(run.state["time"].iloc[-1])


def test_laps_and_the_end_are_those_of_the_race(run):
    made = record_of(run).whole()
    times = [each["t"] for each in made["crossings"]]
    np.testing.assert_allclose(times, FIRST + LAP / GATES * np.arange(2 * GATES + 1), atol=1e-3)
    assert made["over"]["finished"] is True and made["over"]["exploration"] == 1.5
    assert made["over"]["t"] == pytest.approx(run.state["time"].iloc[-1], abs=1e-3)


def test_poses_between_samples(run):
    times = np.array([0.011, 0.405])
    p_WB, R_WB = poses_at(run.state, times)
    for time, p, q in zip(times, p_WB, R_WB.as_quat(scalar_first=True)):
        np.testing.assert_allclose(p, flight(time)[0], atol=0.01)
        assert abs(q @ flight(time)[2]) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.slow
def test_it_says_what_the_live_page_was_told(tmp_path, hexagon):
    scenario = load_scenario()
    scenario.track, scenario.referee.time_limit = hexagon, 6.0
    with LivePage(load_track(hexagon)) as page:
        run_race(scenario, tmp_path, page=page)
    live = page.record.whole()
    run = load_run(tmp_path)
    again = record_of(run).whole()
    mine, theirs = frames(live), frames(again)
    common = np.linspace(0.1, 5.9, 50)
    for name in ("x", "y", "z", "speed", "thrust"):
        there = [np.interp(common, each["time"], each[name]) for each in (mine, theirs)]
        np.testing.assert_allclose(*there, atol=0.1, err_msg=name)
    weight = run.vehicle.mass * GRAVITY
    assert mine["thrust"].max() < run.vehicle.max_thrusts.sum() / weight + 0.01
    assert [each["text"] for each in live["events"]] == [each["text"] for each in again["events"]]
    last = {}
    for batch in (live, again):
        for each in batch["maps"]:
            last.setdefault(id(batch), {}).update({m: rest for m, *rest in each["changed"]})
    first, second = last.values()
    assert first.keys() == second.keys()
    for marker in first:
        np.testing.assert_allclose(first[marker], second[marker], atol=0.3)
    # The pictures of the log and those of the page are the same ones.
    pictures = {round(each["t"], 2): each for each in live["pictures"]}
    shared = [
        (pictures[round(p["t"], 2)], p) for p in again["pictures"] if round(p["t"], 2) in pictures
    ]
    assert len(shared) > 10
    for one, other in shared:
        assert [m["id"] for m in one["markers"]] == [m["id"] for m in other["markers"]]
        for a, b in zip(one["markers"], other["markers"]):
            np.testing.assert_allclose(a["corners"], b["corners"], atol=2e-3)
            np.testing.assert_allclose(a["p"], b["p"], atol=0.2)
        decoded = [
            cv2.imdecode(np.frombuffer(base64.b64decode(p["jpeg"]), np.uint8), 0).astype(int)
            for p in (one, other)
        ]
        assert np.abs(decoded[0] - decoded[1]).mean() < 4.0
