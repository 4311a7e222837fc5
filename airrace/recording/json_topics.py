"""What Foxglove has no schema for, as JSON; see models/foxglove/schemas.yaml."""

import base64
import dataclasses as dc
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
import yaml
from numpy.typing import ArrayLike

from airrace.common.files import finite
from airrace.common.resources import models_path
from airrace.math.quaternion import rotation_between
from airrace.systems.estimation.error_state import AT, as_drone_error
from airrace.systems.estimation.navigation import as_navigation
from airrace.systems.planning.lap_plan import LapPlan
from airrace.systems.sensing.imu_samples import as_samples
from airrace.systems.types import Detections, ExplorerEvent, ExplorerStatus, GateCrossing
from airrace.track.gate_map import GateMap
from airrace.track.map_files import map_data, rounded, statistics_data
from airrace.trajopt.flat_trajectory import (
    FlatTrajectory,
    piecewise_polynomial,
    segment_coefficients,
)
from airrace.trajopt.reference import as_reference
from airrace.vehicle.state import State

if TYPE_CHECKING:
    from airrace.systems.estimation.slam_state import SlamState
    from airrace.trajopt.flat_trajectory import FlatTrajectory

PLAN_STEP = 0.02  # s between two samples of a plan
PLAN_COLUMNS = ("x", "y", "z", "vx", "vy", "vz", "yaw")
_PLAN_SUMMARY = ("solve_time", "max_speed", "max_acceleration", "max_rotor_thrust")
# By topic.
SCHEMAS = yaml.safe_load((models_path() / "foxglove" / "schemas.yaml").read_text("utf-8"))


def packed(numbers: ArrayLike, dtype: str) -> str:
    """Returns numbers as text: base64 of an array; dtype: little-endian, such as "<f4"."""
    return base64.b64encode(np.ascontiguousarray(numbers, dtype).tobytes()).decode()


def unpacked(text: str, dtype: str) -> np.ndarray:
    """Returns the numbers of packed(), (n,)."""
    return np.frombuffer(base64.b64decode(text), dtype)


def detections_data(detections: Detections) -> dict:
    """Returns a message of /detections."""
    return {
        "time": detections.time,
        "markers": [
            {
                "id": m.id,
                "position": rounded(m.X_CM.translation()),
                "orientation": rounded(m.X_CM.rotation().ToQuaternion().wxyz(), 5),
                "corners": m.corners.round(2).ravel().tolist(),
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


def imu_samples_data(samples: np.ndarray) -> dict:
    """Returns a message of /imu/samples, of samples oldest first, (n, 7)."""
    return {"samples": packed(samples, "<f8")}


def estimator_data(state: "SlamState", error: np.ndarray) -> dict:
    """Returns a message of /estimator.

    Args:
        state: what the estimator believes.
        error: of attitude (rad), position (m) and velocity (m/s), see estimate_error(), (9,).
    """
    belief = state.belief
    sigma = as_drone_error(np.sqrt(np.diag(belief.covariance)))
    navigation = as_navigation(belief.navigation)
    vectors = {
        "attitude_error": error[AT.theta],
        "position_error": error[AT.position],
        "velocity_error": error[AT.velocity],
        "attitude_sigma": sigma.theta,
        "position_sigma": sigma.position,
        "velocity_sigma": sigma.velocity,
        "gyro_bias": navigation.gyro_bias,
        "accelerometer_bias": navigation.accel_bias,
        "gyro_bias_sigma": sigma.gyro_bias,
        "accelerometer_bias_sigma": sigma.accel_bias,
    }
    return finite(
        {
            "time": state.time,
            "seen_at": max((each.seen_at for each in state.landmarks), default=-1.0),
            **{name: dict(zip("xyz", vector.tolist())) for name, vector in vectors.items()},
            "covariance": packed(belief.covariance[: len(error), : len(error)], "<f4"),
            "innovations": [
                {"marker": id, "squared": round(float(squared), 2)}
                for id, squared in state.innovations
            ],
            "fault": state.fault,
        }
    )


def estimate_error(truth: State, estimate: State) -> np.ndarray:
    """Returns the errors that an estimate has, as in error_state.py, (9,).

    Those are a rotation vector in axes of the body (rad), and truth less estimate of position (m)
    and velocity (m/s) in world.
    """
    turn = rotation_between(estimate.quaternion, truth.quaternion)
    offsets = truth.position - estimate.position, truth.velocity - estimate.velocity
    return np.concatenate([turn, *offsets])


def full_map_data(gate_map: GateMap) -> dict:
    """Returns a message of /map."""
    rows = [[marker.id, *marker.p_WM, *marker.variance] for marker in gate_map.markers]
    texts = {"map": map_data(gate_map), "statistics": statistics_data(gate_map)}
    return {**finite(texts), "markers": packed(rows, "<f8")}


def plan_data(plan: LapPlan) -> dict:
    """Returns a message of /plan."""
    return {
        "lap": plan.lap,
        "start_time": plan.start_time,
        "entry_duration": plan.entry.duration,
        "phase": plan.phase,
        "duration": plan.circuit.duration,
        # A planner of one's own may know nothing of gates.
        "gate_times": [float(t) for t in getattr(plan.circuit, "gate_times", ())],
        **{name: getattr(plan.summary, name) for name in _PLAN_SUMMARY},
        "step": PLAN_STEP,
        "entry": _samples(plan.entry),
        "circuit": _samples(plan.circuit),
        "polynomials": [_polynomial(each) for each in (plan.entry, plan.circuit)],
    }


def _samples(trajectory: FlatTrajectory) -> dict:
    samples = as_reference(trajectory.sample(np.arange(0.0, trajectory.duration, PLAN_STEP)))
    rows = np.vstack([samples.position, samples.velocity, samples.yaw]).round(4)
    return dict(zip(PLAN_COLUMNS, rows.tolist()))


def _polynomial(trajectory: FlatTrajectory) -> dict:
    """Returns what polynomial_trajectory() makes the trajectory of again."""
    coefficients = segment_coefficients(trajectory.polynomial)
    return {"breaks": list(trajectory.breaks), "coefficients": packed(coefficients, "<f8")}


def polynomial_trajectory(data: dict) -> FlatTrajectory:
    """Returns the entry or the circuit of ``polynomials`` in a message of /plan."""
    breaks = np.array(data["breaks"])
    coefficients = unpacked(data["coefficients"], "<f8").reshape(len(breaks) - 1, 4, -1)
    return FlatTrajectory(piecewise_polynomial(coefficients, breaks))


def status_data(status: ExplorerStatus, entered: Iterable[ExplorerEvent]) -> dict:
    """Returns a message of /explorer/status; entered: the states since the one before."""
    names = ("state", "reason", "since", "closed_at", "done")
    return {
        **{name: getattr(status, name) for name in names},
        "gates": [int(gate) for gate in status.gates],
        "entered": [dc.asdict(event) for event in entered],
    }


def crossing_data(crossing: GateCrossing) -> dict:
    """Returns a message of /referee/crossings."""
    return dc.asdict(crossing)
