"""What Foxglove has no schema for, as JSON with schemas of ours."""

import numpy as np

from airrace.common.files import finite
from airrace.systems.planning.lap_plan import LapPlan
from airrace.systems.referee_status import GateCrossing
from airrace.systems.types import Detections
from airrace.track.gate_map import GateMap
from airrace.track.map_files import map_data, rounded, statistics_data

PLAN_STEP = 0.02  # s between two samples of a plan
PLAN_COLUMNS = ("x", "y", "z", "vx", "vy", "vz", "yaw")
_PLAN_ROWS = (0, 1, 2, 3, 4, 5, 15)  # of trajopt/reference.py


def _schema(name: str, description: str, properties: dict) -> dict:
    return {
        "type": "object",
        "title": f"airrace.{name}",
        "description": description,
        "properties": properties,
    }


_NUMBER, _TEXT, _OBJECT = {"type": "number"}, {"type": "string"}, {"type": "object"}
_NUMBERS = {"type": "array", "items": _NUMBER}
_TABLE = {"type": "object", "additionalProperties": _NUMBERS}


def _list(properties):
    return {"type": "array", "items": {"type": "object", "properties": properties}}


DETECTIONS = _schema(
    "Detections",
    "All markers found in one image.",
    {
        "time": {**_NUMBER, "description": "when the image was taken (s)"},
        "markers": _list(
            {
                "id": _NUMBER,
                "position": {**_NUMBERS, "description": "of the marker in the camera frame (m)"},
                "orientation": {**_NUMBERS, "description": "R_CM as a quaternion w, x, y, z"},
                "reprojection_error": {**_NUMBER, "description": "RMS (px)"},
                "ambiguity": _NUMBER,
            }
        ),
        "refused": _list({"reason": _TEXT, "id": {"type": ["number", "null"]}}),
    },
)
MAP = _schema(
    "Map",
    "The autonomy's map; see map.json and map_statistics.json.",
    {"map": _OBJECT, "statistics": _OBJECT},
)
PLAN = _schema(
    "LapPlan",
    "A plan of laps, from when it was made.",
    {
        "lap": {**_NUMBER, "description": "the first lap flown on it"},
        "start_time": {**_NUMBER, "description": "when the entry starts (s)"},
        "entry_duration": _NUMBER,
        "phase": {**_NUMBER, "description": "where on the circuit the entry ends (s)"},
        "duration": {**_NUMBER, "description": "of the circuit (s)"},
        "gate_times": {**_NUMBERS, "description": "on the circuit, then its duration (s)"},
        "solve_time": _NUMBER,
        "max_speed": _NUMBER,
        "max_acceleration": _NUMBER,
        "max_rotor_thrust": _NUMBER,
        "step": {**_NUMBER, "description": "between two samples (s)"},
        "entry": {**_TABLE, "description": "samples: m, m/s, rad"},
        "circuit": _TABLE,
    },
)
CROSSING = _schema(
    "GateCrossing",
    "A gate that counted.",
    {
        "time": _NUMBER,
        "lap": _NUMBER,
        "gate": _NUMBER,
        "offset": {**_NUMBER, "description": "from the gate's midpoint (m)"},
        "max_speed": {**_NUMBER, "description": "since the one before (m/s)"},
    },
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
    report = plan.report
    return {
        "lap": plan.lap,
        "start_time": plan.start_time,
        "entry_duration": plan.entry.duration,
        "phase": plan.phase,
        "duration": plan.circuit.duration,
        # A planner of one's own may know nothing of gates.
        "gate_times": [float(t) for t in getattr(plan.circuit, "gate_times", ())],
        **(
            {}
            if report is None
            else {
                "solve_time": report.solve_time,
                "max_speed": report.max_speed,
                "max_acceleration": report.max_acceleration,
                "max_rotor_thrust": report.max_rotor_thrust,
            }
        ),
        "step": PLAN_STEP,
        "entry": _samples(plan.entry),
        "circuit": _samples(plan.circuit),
    }


def _samples(trajectory) -> dict:
    values = trajectory.sample(np.arange(0.0, trajectory.duration, PLAN_STEP))
    return {name: _rounded(values[row]) for name, row in zip(PLAN_COLUMNS, _PLAN_ROWS)}


def crossing_data(crossing: GateCrossing) -> dict:
    """Returns a message of the schema CROSSING."""
    return {name: getattr(crossing, name) for name in CROSSING["properties"]}


def _rounded(values, digits=4) -> list:
    return np.round(values, digits).tolist()
