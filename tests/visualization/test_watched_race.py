"""The live view of a whole race."""

import json

import pytest

from airrace.diagrams.race import run_race
from airrace.scenario import load_scenario
from airrace.track import load_track
from airrace.visualization import meshcat_page
from airrace.visualization.live_page import LivePage


class _Watched(meshcat_page.Audience):
    """An audience that always looks."""

    def waits(self):
        return True


@pytest.fixture
def run(tmp_path, hexagon, monkeypatch):
    """Flies the beginning of a race, in which the first gate is found."""
    monkeypatch.setattr("airrace.visualization.live_page.Audience", _Watched)

    def run(name, page=None, text="{}"):
        scenario = load_scenario(scenario_text=text)
        scenario.track = hexagon
        scenario.referee.time_limit = 6.0
        folder = tmp_path / name
        folder.mkdir()
        run_race(scenario, folder, page=page)
        return folder

    return run


@pytest.mark.slow
@pytest.mark.parametrize("text", ["{}", "{disturbances: {gate_shift: 1.0}, drone: StarOne}"])
def test_a_race_that_is_watched_is_the_same_race(run, hexagon, text):
    with LivePage(load_track(hexagon)) as page:
        folders = [run("alone", text=text), run("watched", page, text)]
        assert page.meshcat.HasPath("visualizer/drone/body")
    results = [json.loads((folder / "race.json").read_text()) for folder in folders]
    for result in results:
        del result["wall"]
    assert results[0] == results[1]
    assert (folders[0] / "map.json").read_bytes() == (folders[1] / "map.json").read_bytes()
    told = page.record.whole()
    assert {"frames", "status", "events", "maps", "over"} <= set(told)
    assert ("shifts" in told) == ("gate_shift" in text)
    assert len(told["pictures"]) > 25
    assert all(len(picture["markers"]) > 1 for picture in told["pictures"])
    assert told["over"]["finished"] is False and "time" in told["over"]["reason"]
    assert '"mode":"replay"' in (folders[1] / "race.html").read_text()
