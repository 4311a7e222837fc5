"""The fields of `perception`, from a scenario through a flight to the files of the map."""

import json
import math

import pytest

from airrace.diagrams.autonomy import MakeAutonomy
from airrace.diagrams.race import run_race
from airrace.scenario import PerceptionConfig, Scenario
from airrace.systems.perception.marker_measurement import DetectorConfig

ORIGINAL = PerceptionConfig(
    corners="opencv",
    poses="marker",
    jump_filter=False,
    max_range=math.inf,
    max_gates=10,
    map_estimator="original",
    min_observations=1,
    map_period=0.1,
)


def test_they_reach_the_detector():
    for perception in (PerceptionConfig(), ORIGINAL):
        autonomy = MakeAutonomy(Scenario(perception=perception))
        assert autonomy.GetSubsystemByName("aruco_detector")._config == DetectorConfig(
            corners=perception.corners, poses=perception.poses, jump_filter=perception.jump_filter
        )


@pytest.mark.slow
@pytest.mark.parametrize("perception", [PerceptionConfig(), ORIGINAL], ids=["ours", "original"])
def test_the_first_seconds_of_a_flight(tmp_path, perception):
    """The first gates stand 20 m and more away; how often the files are written is a field."""
    scenario = Scenario(laps=1, perception=perception)
    scenario.referee.time_limit = 6.0
    written = set()

    def look(*_):
        file = tmp_path / "map_statistics.json"
        if file.exists():
            written.add(json.loads(file.read_text())["time_s"])

    run_race(scenario, tmp_path, sinks=[look])
    statistics = json.loads((tmp_path / "map_statistics.json").read_text())
    ours = perception is not ORIGINAL
    assert (len(written) < 6) == ours
    assert statistics["detections"] > 50
    seen = sum(marker["detections"] for marker in statistics["markers"])
    if ours:
        assert statistics["refused"]["beyond the range"] > 0
    else:
        # All that is no reading of another ID, or of a face from behind, is kept for good.
        assert not {"beyond the range", "pose jumps"} & statistics["refused"].keys()
        refused = sum(statistics["refused"].values()) - statistics["outliers"]
        assert statistics["detections"] <= seen + refused
        assert {0, 2} <= {marker["id"] for marker in statistics["markers"]}
