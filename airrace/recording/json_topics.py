"""What Foxglove has no schema for, as JSON; see models/foxglove/schemas.yaml."""

import dataclasses as dc
from typing import TYPE_CHECKING

import numpy as np
import yaml

from airrace.common.files import finite
from airrace.common.resources import models_path
from airrace.systems.planning.lap_plan import LapPlan
from airrace.systems.sensing.imu_samples import as_samples
from airrace.systems.types import Detections, GateCrossing
from airrace.track.gate_map import GateMap
from airrace.track.map_files import map_data, rounded, statistics_data
from airrace.trajopt.reference import as_reference

if TYPE_CHECKING:
    from airrace.trajopt.flat_trajectory import FlatTrajectory

PLAN_STEP = 0.02  # s between two samples of a plan
PLAN_COLUMNS = ("x", "y", "z", "vx", "vy", "vz", "yaw")
_PLAN_SUMMARY = ("solve_time", "max_speed", "max_acceleration", "max_rotor_thrust")
# By topic.
SCHEMAS = yaml.safe_load((models_path() / "foxglove" / "schemas.yaml").read_text("utf-8"))


def detections_data(detections: Detections) -> dict:
    """Returns a message of /detections."""
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


def imu_data(vector: np.ndarray) -> dict:
    """Returns a message of /imu, of the newest of some samples, (7 n,)."""
    time, *vectors = (each[0] for each in as_samples(vector))
    w, f = (dict(zip("xyz", rounded(v, 6))) for v in vectors)
    return finite({"time": float(time), "angular_velocity": w, "specific_force": f})


def full_map_data(gate_map: GateMap) -> dict:
    """Returns a message of /map."""
    return finite({"map": map_data(gate_map), "statistics": statistics_data(gate_map)})


def plan_data(plan: LapPlan) -> dict:
    """Returns a message of /plan."""
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


def _samples(trajectory: "FlatTrajectory") -> dict:
    samples = as_reference(trajectory.sample(np.arange(0.0, trajectory.duration, PLAN_STEP)))
    rows = np.vstack([samples.position, samples.velocity, samples.yaw]).round(4)
    return dict(zip(PLAN_COLUMNS, rows.tolist()))


def crossing_data(crossing: GateCrossing) -> dict:
    """Returns a message of /referee/crossings."""
    return dc.asdict(crossing)
