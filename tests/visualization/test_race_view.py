"""The live view of a whole race."""

import json

import pytest

from airrace.diagrams.race import run_race
from airrace.scenario import load_scenario
from airrace.track import load_track
from airrace.visualization import meshcat_page
from airrace.visualization.meshcat_page import HUD, MakeMeshcat


class _Watched(meshcat_page.Audience):
    """An audience that always looks."""

    def waits(self):
        return True


@pytest.fixture
def run(tmp_path, hexagon, monkeypatch):
    """Flies the beginning of a race, in which the first gate is found."""
    monkeypatch.setattr("airrace.visualization.camera_inset.Audience", _Watched)
    monkeypatch.setattr("airrace.visualization.scoreboard.Audience", _Watched)

    def run(name, meshcat=None, text="{}", show=lambda record, look: None):
        scenario = load_scenario(scenario_text=text)
        scenario.track = hexagon
        scenario.referee.time_limit = 6.0
        folder = tmp_path / name
        folder.mkdir()
        run_race(scenario, folder, meshcat=meshcat, show=show)
        return folder

    return run


@pytest.mark.slow
@pytest.mark.parametrize("text", ["{}", "{disturbances: {gate_shift: 1.0}, drone: StarOne}"])
def test_a_race_that_is_watched_is_the_same_race(run, hexagon, text):
    meshcat = MakeMeshcat(load_track(hexagon))
    live = []

    def look(record, look):
        live.append(
            tuple(
                map(
                    meshcat.HasPath,
                    (
                        f"{HUD}/camera",
                        f"{HUD}/scoreboard",
                        "rays",
                        "flown/0",
                        "map/0",
                        "visualizer/drone/body/frustum",
                    ),
                )
            )
        )

    folders = [run("alone", text=text), run("watched", meshcat, text, look)]
    results = [json.loads((folder / "race.json").read_text()) for folder in folders]
    for result in results:
        del result["wall"]
    assert results[0] == results[1]
    assert (folders[0] / "map.json").read_bytes() == (folders[1] / "map.json").read_bytes()
    assert any(all(seen) for seen in live)  # everything was drawn at once
    # What only makes sense live is not in the replay.
    assert not meshcat.HasPath(HUD) and not meshcat.HasPath("rays")
    assert meshcat.GetButtonNames() == [] and meshcat.GetSliderNames() == []
    assert meshcat.HasPath("flown/0") and "</html>" in (folders[1] / "race.html").read_text()
