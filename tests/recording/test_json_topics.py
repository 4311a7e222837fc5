import json

import numpy as np
from pydrake.math import RigidTransform

from airrace.recording import json_topics
from airrace.systems.planning.lap_plan import LapPlan, PlanSummary
from airrace.systems.types import Detection, Detections, GateCrossing
from airrace.track.gate_map import GateMap, MarkerEstimate
from airrace.trajopt.flat_trajectory import FlatTrajectory


def as_json(message):
    return json.loads(json.dumps(message, allow_nan=False))


def test_detections():
    marker = Detection(
        id=7,
        corners=np.zeros((4, 2)),
        X_CM=RigidTransform([1.0, -2.0, 9.0]),
        reprojection_error=0.1234,
        ambiguity=0.5,
    )
    message = as_json(
        json_topics.detections_data(Detections(2.5, (marker,), (("blurred", 3), ("image", None))))
    )
    assert message == {
        "time": 2.5,
        "markers": [
            {
                "id": 7,
                "position": [1.0, -2.0, 9.0],
                "orientation": [1.0, 0.0, 0.0, 0.0],
                "corners": [0.0] * 8,
                "reprojection_error": 0.123,
                "ambiguity": 0.5,
            }
        ],
        "refused": [{"reason": "blurred", "id": 3}, {"reason": "image", "id": None}],
    }
    assert list(message) == list(json_topics.SCHEMAS["/detections"]["properties"])


def test_a_map_is_valid_json_whatever_is_in_it():
    marker = MarkerEstimate(
        id=0,
        count=1,
        outliers=0,
        p_WM=np.zeros(3),
        variance=np.full(3, np.inf),
        normal=np.array([1.0, 0, 0]),
    )
    message = as_json(json_topics.full_map_data(GateMap(1.0, (marker,))))
    assert list(message) == list(json_topics.SCHEMAS["/map"]["properties"])
    assert message["statistics"]["markers"][0]["variance"] == [None] * 3


def test_a_plan_has_samples_of_both_parts():
    rest = FlatTrajectory.resting([1.0, 2.0, 3.0, 0.5])
    message = as_json(json_topics.plan_data(LapPlan(2, 10.0, rest, rest, 0.0, PlanSummary(0.1))))
    assert set(message) <= set(json_topics.SCHEMAS["/plan"]["properties"])
    assert message["solve_time"] == 0.1
    assert message["gate_times"] == []  # it is no Circuit
    assert message["circuit"] == {
        "x": [1.0],
        "y": [2.0],
        "z": [3.0],
        "vx": [0.0],
        "vy": [0.0],
        "vz": [0.0],
        "yaw": [0.5],
    }


def test_a_crossing():
    crossing = GateCrossing(time=3.5, gate=2, lap=1, offset=0.25, max_speed=9.0)
    assert set(json_topics.SCHEMAS["/referee/crossings"]["properties"]) == set(vars(crossing))
    assert json_topics.crossing_data(crossing) == {
        "time": 3.5,
        "lap": 1,
        "gate": 2,
        "offset": 0.25,
        "max_speed": 9.0,
    }
