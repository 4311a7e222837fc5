"""Maps that are given: the truth, or files of earlier races."""

import json

import numpy as np
import pytest

from airrace.errors import UserError
from airrace.map_files import write_map
from airrace.systems.known_map import KnownMap, NoDetector, load_map
from airrace.systems.types import Detections
from airrace.track import load_track

TRUTH = load_map("track", "student-airrace")


def test_the_truth():
    track = load_track("student-airrace")
    assert [gate.number for gate in TRUTH.gates] == list(range(10))
    np.testing.assert_allclose([gate.p_WG for gate in TRUTH.gates],
                               [gate.p_WG for gate in track.gates])
    np.testing.assert_allclose(np.array([gate.pylons for gate in TRUTH.gates]).reshape(-1, 2),
                               track.pylons()[:, :2], atol=1e-12)
    assert len(TRUTH.markers) == 40


def test_the_map_of_an_earlier_race(tmp_path):
    write_map(tmp_path, TRUTH)
    again = load_map(str(tmp_path / "map.json"), "student-airrace")
    for one, other in zip(again.gates, TRUTH.gates, strict=True):
        np.testing.assert_allclose(one.p_WG, other.p_WG, atol=1e-4)
        assert (one.number, one.heading, one.spacing) == pytest.approx(
            (other.number, other.heading, other.spacing), abs=1e-4)
    for one, other in zip(again.markers, TRUTH.markers, strict=True):
        np.testing.assert_allclose(one.p_WM, other.p_WM, atol=1e-4)


@pytest.mark.parametrize("change", [
    lambda data: data.pop("gates"),
    lambda data: data["gates"].pop(3),
    lambda data: data["gates"].clear(),
    lambda data: data["gates"][0].update(midpoint=[1.0, 2.0]),
    lambda data: data["gates"][0].update(heading_deg=float("nan")),
    lambda data: data["gates"][0].update(spacing="wide"),
    lambda data: data.update(gates=5),
])
def test_what_is_no_map_is_one_sentence(tmp_path, change):
    write_map(tmp_path, TRUTH)
    file = tmp_path / "map.json"
    data = json.loads(file.read_text())
    change(data)
    file.write_text(json.dumps(data))
    with pytest.raises(UserError, match="map.json"):
        load_map(str(file), "student-airrace")


@pytest.mark.parametrize("text", [None, "", "[1, 2]", "nonsense"])
def test_no_file_and_no_json(tmp_path, text):
    file = tmp_path / "map.json"
    if text is not None:
        file.write_text(text)
    with pytest.raises(UserError, match="map.json of an earlier race"):
        load_map(str(file), "student-airrace")


def test_the_boxes_show_what_they_were_given():
    box = KnownMap(TRUTH)
    assert box.GetOutputPort("gate_map").Eval(box.CreateDefaultContext()) is TRUTH
    box = NoDetector()
    seen = box.GetOutputPort("detections").Eval(box.CreateDefaultContext())
    assert isinstance(seen, Detections) and not seen.markers
