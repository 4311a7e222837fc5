"""What Foxglove has no schema for, as JSON with schemas of ours."""

import dataclasses as dc

import numpy as np

from airrace.common.files import finite
from airrace.systems.planning.lap_plan import LapPlan
from airrace.systems.types import Detections, GateCrossing
from airrace.track.gate_map import GateMap
from airrace.track.map_files import map_data, rounded, statistics_data
from airrace.trajopt.reference import as_reference

PLAN_STEP = 0.02  # s between two samples of a plan
PLAN_COLUMNS = ("x", "y", "z", "vx", "vy", "vz", "yaw")
_PLAN_SUMMARY = ("solve_time", "max_speed", "max_acceleration", "max_rotor_thrust")
_NUMBER, _TEXT, _OBJECT = {"type": "number"}, {"type": "string"}, {"type": "object"}
_NUMBERS = {"type": "array", "items": _NUMBER}
_TABLE = {"type": "object", "additionalProperties": _NUMBERS}


def _schema(name: str, description: str, **properties) -> dict:
    return {
        "type": "object",
        "title": f"airrace.{name}",
        "description": description,
        "properties": properties,
    }


def _list(**properties) -> dict:
    return {"type": "array", "items": {"type": "object", "properties": properties}}


def _said(schema: dict, description: str) -> dict:
    return {**schema, "description": description}


DETECTIONS = _schema(
    "Detections",
    "All markers found in one image.",
    time=_said(_NUMBER, "when the image was taken (s)"),
    markers=_list(
        id=_NUMBER,
        position=_said(_NUMBERS, "of the marker in the camera frame (m)"),
        orientation=_said(_NUMBERS, "R_CM as a quaternion w, x, y, z"),
        reprojection_error=_said(_NUMBER, "RMS (px)"),
        ambiguity=_NUMBER,
    ),
    refused=_list(reason=_TEXT, id={"type": ["number", "null"]}),
)
MAP = _schema(
    "Map",
    "The autonomy's map; see map.json and map_statistics.json.",
    map=_OBJECT,
    statistics=_OBJECT,
)
PLAN = _schema(
    "LapPlan",
    "A plan of laps, from when it was made.",
    lap=_said(_NUMBER, "the first lap flown on it"),
    start_time=_said(_NUMBER, "when the entry starts (s)"),
    entry_duration=_NUMBER,
    phase=_said(_NUMBER, "where on the circuit the entry ends (s)"),
    duration=_said(_NUMBER, "of the circuit (s)"),
    gate_times=_said(_NUMBERS, "on the circuit, then its duration (s)"),
    **dict.fromkeys(_PLAN_SUMMARY, _NUMBER),
    step=_said(_NUMBER, "between two samples (s)"),
    entry=_said(_TABLE, "samples: m, m/s, rad"),
    circuit=_TABLE,
)
CROSSING = _schema(
    "GateCrossing",
    "A gate that counted: when (s), how far from its midpoint (m), how fast since the last (m/s).",
    **{field.name: _NUMBER for field in dc.fields(GateCrossing)},
)


def detections_data(detections: Detections) -> dict:
    """Returns a message of the schema DETECTIONS."""
    return {
        "time": detections.time,
        "markers": [
            {
                "id": m.id,
                "position": rounded(m.X_CM.translation()),
                "orientation": rounded(m.X_CM.rotation().ToQuaternion().wxyz(), 5),
                "reprojection_error": round(float(m.reprojection_error), 3),
                "ambiguity": round(float(m.ambiguity), 3),
            }
            for m in detections.markers
        ],
        "refused": [{"reason": reason, "id": marker} for reason, marker in detections.refused],
    }


def full_map_data(gate_map: GateMap) -> dict:
    """Returns a message of the schema MAP."""
    return finite({"map": map_data(gate_map), "statistics": statistics_data(gate_map)})


def plan_data(plan: LapPlan) -> dict:
    """Returns a message of the schema PLAN."""
    summary = {name: getattr(plan.summary, name) for name in _PLAN_SUMMARY} if plan.summary else {}
    return {
        "lap": plan.lap,
        "start_time": plan.start_time,
        "entry_duration": plan.entry.duration,
        "phase": plan.phase,
        "duration": plan.circuit.duration,
        # A planner of one's own may know nothing of gates.
        "gate_times": [float(t) for t in getattr(plan.circuit, "gate_times", ())],
        **summary,
        "step": PLAN_STEP,
        "entry": _samples(plan.entry),
        "circuit": _samples(plan.circuit),
    }


def _samples(trajectory) -> dict:
    samples = as_reference(trajectory.sample(np.arange(0.0, trajectory.duration, PLAN_STEP)))
    rows = np.vstack([samples.position, samples.velocity, samples.yaw]).round(4)
    return dict(zip(PLAN_COLUMNS, rows.tolist()))


def crossing_data(crossing: GateCrossing) -> dict:
    """Returns a message of the schema CROSSING."""
    return dc.asdict(crossing)
