import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.common.errors import UserError
from airrace.systems.mapping.original_estimator import EMPTY, OriginalEstimator
from airrace.track import load_track
from airrace.track.gate_map import GateMap, MarkerEstimate
from airrace.track.map_files import map_data, read_map, statistics_data, write_map

TRUTH = read_map("track", "student-airrace")
_numbers = st.floats(-1e4, 1e4)
_vectors = st.tuples(_numbers, _numbers, _numbers).map(np.array)

ESTIMATOR = OriginalEstimator(outlier_sigma=3.0, min_observations=5)


@st.composite
def maps(draw):
    """Maps as the mapper makes them."""
    ids = draw(st.sets(st.integers(0, 79), max_size=12))
    statistics = {}
    for id in ids:
        p_WM, normal, far = draw(_vectors), draw(_vectors), draw(_vectors)
        statistics[id] = EMPTY
        for p in [*draw(st.integers(1, 20)) * [p_WM], *draw(st.integers(0, 2)) * [far]]:
            statistics[id] = statistics[id].updated(p, normal, 3.0)
    out_of_range = draw(st.integers(0, 100))
    return ESTIMATOR.make_map(
        statistics,
        time=draw(st.floats(0, 1e3)),
        detections=out_of_range + draw(st.integers(0, 1000)),
        out_of_range=out_of_range,
        refused=draw(st.dictionaries(st.text(max_size=9), st.integers(1, 99), max_size=3)),
    )


def test_an_empty_map(tmp_path):
    write_map(tmp_path, GateMap())
    assert json.loads((tmp_path / "map.json").read_text()) == {
        "time_s": None,
        "gates": [],
        "markers": [],
    }
    assert json.loads((tmp_path / "map_statistics.json").read_text()) == {
        "time_s": None,
        "detections": 0,
        "out_of_range_ids": 0,
        "error_rate": 0.0,
        "error_rate_percent": 0.0,
        "outliers": 0,
        "refused": {},
        "markers": [],
    }


@given(maps())
def test_the_files_say_what_the_map_says(tmp_path_factory, gate_map):
    folder = tmp_path_factory.getbasetemp()
    write_map(folder, gate_map)
    data = json.loads((folder / "map.json").read_text())
    assert data == map_data(gate_map)
    assert data["time_s"] == gate_map.time
    assert [g["gate"] for g in data["gates"]] == [g.number + 1 for g in gate_map.gates]
    for entry, gate in zip(data["gates"], gate_map.gates):
        np.testing.assert_allclose(entry["midpoint"], gate.p_WG, atol=1e-4)
        assert entry["heading_deg"] == pytest.approx(np.rad2deg(gate.heading), abs=1e-3)
        assert entry["spacing"] == pytest.approx(gate.spacing, abs=1e-4)
        assert entry.keys() == {"gate", "midpoint", "heading_deg", "spacing"}
    for entry, marker in zip(data["markers"], gate_map.markers, strict=True):
        assert entry["id"] == marker.id
        np.testing.assert_allclose(entry["position"], marker.p_WM, atol=1e-4)
        np.testing.assert_allclose(entry["normal"], marker.normal, atol=1e-4)

    data = json.loads((folder / "map_statistics.json").read_text())
    assert data == statistics_data(gate_map)
    assert data["time_s"] == gate_map.time
    assert data["detections"] == gate_map.detections
    assert data["out_of_range_ids"] == gate_map.out_of_range
    assert data["refused"] == gate_map.refused
    assert 0 <= data["error_rate"] <= 1
    errors = data["error_rate"] * max(data["detections"], 1)
    assert errors == pytest.approx(data["out_of_range_ids"])
    assert data["error_rate_percent"] == pytest.approx(100 * data["error_rate"])
    assert data["outliers"] == sum(entry["outliers"] for entry in data["markers"])
    for entry, marker in zip(data["markers"], gate_map.markers, strict=True):
        assert (entry["id"], entry["observations"], entry["outliers"]) == (
            marker.id,
            marker.count,
            marker.outliers,
        )
        assert entry["detections"] == marker.count + marker.outliers
        np.testing.assert_allclose(entry["mean"], marker.p_WM, atol=1e-4)
        np.testing.assert_allclose(entry["variance"], marker.variance, atol=1e-6)


def test_a_broken_map_still_makes_valid_files(tmp_path):
    lost = MarkerEstimate(0, 9, 0, np.full(3, np.nan), np.full(3, np.inf), np.ones(3))
    write_map(tmp_path, GateMap(time=float("nan"), markers=(lost,), detections=9))
    for name in ("map.json", "map_statistics.json"):
        text = (tmp_path / name).read_text()
        assert "NaN" not in text
        assert json.loads(text)["time_s"] is None


def test_the_truth():
    track = load_track("student-airrace")
    assert [gate.number for gate in TRUTH.gates] == list(range(10))
    np.testing.assert_allclose(
        [gate.p_WG for gate in TRUTH.gates], [gate.p_WG for gate in track.gates]
    )
    np.testing.assert_allclose(
        np.array([gate.pylons for gate in TRUTH.gates]).reshape(-1, 2),
        track.pylons()[:, :2],
        atol=1e-12,
    )
    assert len(TRUTH.markers) == 40


def test_the_map_of_an_earlier_race(tmp_path):
    write_map(tmp_path, TRUTH)
    again = read_map(str(tmp_path / "map.json"), "student-airrace")
    for one, other in zip(again.gates, TRUTH.gates, strict=True):
        np.testing.assert_allclose(one.p_WG, other.p_WG, atol=1e-4)
        assert (one.number, one.heading, one.spacing) == pytest.approx(
            (other.number, other.heading, other.spacing), abs=1e-4
        )
    for one, other in zip(again.markers, TRUTH.markers, strict=True):
        np.testing.assert_allclose(one.p_WM, other.p_WM, atol=1e-4)


@pytest.mark.parametrize(
    "change",
    [
        lambda data: data.pop("gates"),
        lambda data: data["gates"].pop(3),
        lambda data: data["gates"].clear(),
        lambda data: data["gates"][0].update(midpoint=[1.0, 2.0]),
        lambda data: data["gates"][0].update(heading_deg=float("nan")),
        lambda data: data["gates"][0].update(spacing="wide"),
        lambda data: data["gates"][0].update(spacing=-1.0),
        lambda data: data["gates"][0].update(midpoint=[1.0, 2.0, 1e9]),
        lambda data: data["markers"][0].update(id=1.5),
        lambda data: data.update(gates=5),
    ],
)
def test_what_is_no_map_is_one_sentence(tmp_path, change):
    write_map(tmp_path, TRUTH)
    file = tmp_path / "map.json"
    data = json.loads(file.read_text())
    change(data)
    file.write_text(json.dumps(data))
    with pytest.raises(UserError, match="map.json"):
        read_map(str(file), "student-airrace")


@pytest.mark.parametrize("text", [None, "", "[1, 2]", "nonsense"])
def test_no_file_and_no_json(tmp_path, text):
    file = tmp_path / "map.json"
    if text is not None:
        file.write_text(text)
    with pytest.raises(UserError, match="map.json of an earlier race"):
        read_map(str(file), "student-airrace")
