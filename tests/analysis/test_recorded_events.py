"""A replay shows what the live page has shown."""

import base64

import numpy as np
import pytest

from airrace.analysis import load_run
from airrace.analysis.recorded_events import recorded_events
from airrace.common.errors import UserError
from airrace.diagrams.race import run_race
from airrace.recording import race_events as events
from airrace.recording.json_topics import crossing_data
from airrace.recording.race_events import GateCrossed, StateSample
from airrace.recording.writer import RaceLog
from airrace.scenario import load_scenario
from airrace.track import load_track
from airrace.visualization.ghosts import record_of
from airrace.visualization.live_page import LivePage
from airrace.visualization.race_record import FRAME
from tests.worlds.made_up_run import FIRST, GATES, LAP, WAITED, crossings, flight, make_run


def frames(batch):
    data = np.frombuffer(base64.b64decode(batch.pop("frames")), "<f4")
    return data.reshape(-1, len(FRAME))


RACES = {
    "finding gates and itself": (
        "{estimator: vio, camera: {width: 640, height: 360}}",
        5.0,
        {"estimates"},
    ),
    "a lap between gates that move": (
        "{laps: 1, map: track, disturbances: {gate_shift: 1.0}, camera: {width: 640, height: 360, fps: 10}}",
        60.0,
        {"crossings", "plans", "shifts"},
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("text, limit, lists", RACES.values(), ids=RACES)
def test_a_replay_shows_what_the_live_page_has_shown(tmp_path, hexagon, text, limit, lists):
    scenario = load_scenario(scenario_text=text)
    scenario.track, scenario.referee.time_limit = hexagon, limit
    with LivePage(load_track(hexagon)) as page:
        run_race(scenario, tmp_path, page=page)
    live, again = page.record.whole(), record_of(load_run(tmp_path)).whole()
    # The log has states in single precision, velocities turned into the body's axes.
    np.testing.assert_allclose(frames(live), frames(again), atol=1e-5)
    pictures, replayed = live.pop("pictures"), again.pop("pictures")
    assert [each["t"] for each in pictures] == [each["t"] for each in replayed]
    assert len(pictures) > 10
    for one, other in zip(pictures, replayed):
        assert [marker["id"] for marker in one["markers"]] == [m["id"] for m in other["markers"]]
        for a, b in zip(one["markers"], other["markers"]):
            # The log has corners in hundredths of a pixel, and places in tenths of a millimetre:
            # so a last digit that is shown may differ.
            np.testing.assert_allclose(a["corners"], b["corners"], atol=1.01e-4)
            np.testing.assert_allclose(a["p"], b["p"], atol=0.0101)
    assert live.keys() == again.keys() >= {"events", "status", "maps", "over"} | lists
    for name, shown in live.items():
        assert shown == again[name], name


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return load_run(make_run(tmp_path_factory.mktemp("run") / "run", laps=2))


def test_events_are_those_that_were_written(run):
    happened = list(recorded_events(run))
    samples = [event for event in happened if isinstance(event, StateSample)]
    for sample in samples[:: len(samples) // 10]:
        p, v, q = flight(sample.time)
        np.testing.assert_allclose(sample.truth.position, p, atol=1e-5)
        np.testing.assert_allclose(sample.truth.velocity, v, atol=1e-4)
        np.testing.assert_allclose(sample.filtered.quaternion, q, atol=1e-6)
        np.testing.assert_array_equal(sample.rotor_speeds, 40.0)
    crossed = [event.crossing for event in happened if isinstance(event, GateCrossed)]
    assert crossed == crossings(2)
    waits = [event for event in happened if isinstance(event, events.ClockWaits)]
    assert [(event.delay, event.goes_on) for event in waits] == [(WAITED, True), (WAITED, False)]
    assert len([event for event in happened if isinstance(event, events.Picture)]) == 60
    assert not [e for e in recorded_events(run, False) if isinstance(e, events.Picture)]


def test_the_page_of_a_run_ends_as_its_race(run):
    made = record_of(run).whole()
    times = [each["t"] for each in made["crossings"]]
    np.testing.assert_allclose(times, FIRST + LAP / GATES * np.arange(2 * GATES + 1), atol=1e-3)
    assert "the clock waited 0.30 s here" in [each["text"] for each in made["events"]]
    assert made["over"]["finished"] is True and made["over"]["exploration"] == 1.5
    assert made["over"]["t"] == pytest.approx(run.state["time"].iloc[-1], abs=1e-3)


def test_a_log_that_lacks_something_is_refused(run, tmp_path, monkeypatch):
    log = RaceLog(tmp_path / "race.mcap")
    log.write("/plan", 1.0, {"lap": 1, "start_time": 1.0})
    log.write("/referee/crossings", 1.0, crossing_data(crossings(1)[0]))
    log.close()
    monkeypatch.setattr(run, "folder", tmp_path)
    with pytest.raises(
        UserError, match="a message of /plan is not as this airrace writes it.*again"
    ):
        list(recorded_events(run))
