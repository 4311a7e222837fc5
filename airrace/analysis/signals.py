"""The signals of a race as tables of numbers, read from its race.mcap.

SIGNALS says which there are. Everything is SI, in the world frame, angles in rad; but velocities of
states are in the body frame here, as Foxglove defines them. derived.py makes the tables of a Run.
"""

import base64
from collections.abc import Iterable
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from airrace.analysis.log import read_log, reading
from airrace.recording.json_topics import PLAN_COLUMNS

_ODOMETRY = {
    **{axis: f"pose.position.{axis}" for axis in "xyz"},
    **{f"q{axis}": f"pose.orientation.{axis}" for axis in "wxyz"},
    **{f"v{axis}": f"linear_velocity.{axis}" for axis in "xyz"},
    **{f"w{axis}": f"angular_velocity.{axis}" for axis in "xyz"},
}
# Returns position, quaternion, velocity and angular velocity of a message of Odometry.
odometry_numbers = attrgetter(*_ODOMETRY.values())
_STATE = ("time", *_ODOMETRY)
_VECTOR = ("time", "ax", "ay", "az")
_PLAN = (
    "lap start_time entry_duration phase duration solve_time "
    "max_speed max_acceleration max_rotor_thrust"
).split()
# Of a message of /estimator.
ESTIMATOR_VECTORS = (
    *("attitude_error", "position_error", "velocity_error"),
    *("attitude_sigma", "position_sigma", "velocity_sigma"),
    *("gyro_bias", "accelerometer_bias", "gyro_bias_sigma", "accelerometer_bias_sigma"),
)
_TEXTS = ("source", "name", "message", "reason", "part")  # columns that are no numbers
# The largest number of a signal, and by how much the norm of a quaternion may differ from one.
_LARGEST, _NORM = 1e9, 0.5
# The columns of every table, as the log has them.
SIGNALS = {
    "state": _STATE,  # the truth
    "estimate": _STATE,  # what the autonomy is handed
    "filtered": _STATE,  # what its controller uses
    "reference": _STATE,
    "reference_acceleration": _VECTOR,
    "disturbance": _VECTOR,
    # Of samples, which end at the time: angular velocity, specific force; in axes of the body.
    "imu": ("time", "wx", "wy", "wz", "fx", "fy", "fz"),
    "imu_samples": ("time", "wx", "wy", "wz", "fx", "fy", "fz"),  # all of them
    "estimator": (
        *("time", "exposure", "seen_at"),
        *(f"{vector}_{axis}" for vector in ESTIMATOR_VECTORS for axis in "xyz"),
        *(f"position_covariance_{i}" for i in range(9)),  # 3 x 3, row by row (m^2)
        "nees",
    ),
    "innovations": ("time", "marker", "squared"),
    "rotors": ("time", "rotor", "speed", "thrust"),
    "rotor_commands": ("time", "rotor", "speed", "thrust"),
    # Poses are in the camera frame.
    "detections": (
        *("time", "received", "marker", "x", "y", "z", "qw", "qx", "qy", "qz"),
        *("reprojection_error", "ambiguity"),
    ),
    "refused": ("time", "reason", "marker"),
    "map": (
        *("time", "marker", "x", "y", "z", "variance_x", "variance_y", "variance_z"),
        *("observations", "outliers"),
    ),
    "gates": ("time", "gate", "x", "y", "z", "heading"),
    "plans": ("plan", "time", *_PLAN),
    "plan_gates": ("plan", "lap", "gate", "time"),  # on the circuit; at the end, gate 1 again
    "plan_samples": ("plan", "lap", "part", "time", *PLAN_COLUMNS),
    "events": ("time", "source", "name", "message"),
    "crossings": ("time", "lap", "gate", "offset", "max_speed"),
}


def read_signals(path: Path | None, without: Iterable[str] = ()) -> dict[str, pd.DataFrame]:
    """Returns the table of every signal of a race.mcap.

    Args:
        path: the file; None: all tables are empty.
        without: topics to leave out; their tables are empty.

    Raises:
        UserError: if it cannot be read.
    """
    rows = {name: [] for name in SIGNALS}
    if path is not None:
        for topic, time, message in read_log(path, [t for t in _READERS if t not in without]):
            with reading(path, f"a message of {topic}"):
                _READERS[topic](rows, time, message)
    signals = {}
    for name, names in SIGNALS.items():
        with reading(path or Path(), f"the signal {name}"):
            dtype = None if rows[name] else float
            signals[name] = pd.DataFrame(rows[name], columns=names, dtype=dtype)
            if not _is_sound(name, signals[name]):
                raise ValueError
    return signals


def _is_sound(name: str, table: pd.DataFrame) -> bool:
    """Whether the numbers of a signal can be of a race; NaN can."""
    texts = [column for column in _TEXTS if column in table]
    numbers = table.drop(columns=texts).to_numpy(float)
    if np.any(np.abs(numbers) > _LARGEST):
        return False
    if not table[texts].map(lambda text: isinstance(text, str)).all(axis=None):
        return False
    if SIGNALS[name] is not _STATE:
        return True
    norms = np.linalg.norm(table[["qw", "qx", "qy", "qz"]].to_numpy(float), axis=1)
    return not np.any(np.abs(norms - 1.0) > _NORM)


def seconds(stamp: Any) -> float:
    """Returns the time (s) that a message's stamp says."""
    return stamp.seconds + stamp.nanos / 1e9


def _odometry(table):
    def read(rows, time, message):
        rows[table].append((seconds(message.timestamp), *odometry_numbers(message)))

    return read


def _vector(table):
    def read(rows, time, message):
        rows[table].append((time, message.x, message.y, message.z))

    return read


def _imu(rows, time, message):
    if message["time"] >= 0.0:
        vectors = message["angular_velocity"], message["specific_force"]
        values = np.array([v[axis] for v in vectors for axis in "xyz"], float)  # null is NaN
        rows["imu"].append((message["time"], *values))


def _imu_samples(rows, time, message):
    samples = np.frombuffer(base64.b64decode(message["samples"]), "<f8").reshape(-1, 7)
    rows["imu_samples"] += map(tuple, samples.tolist())


def _estimator(rows, time, message):
    vectors = [[message[name][axis] for axis in "xyz"] for name in ESTIMATOR_VECTORS]
    numbers = np.array(vectors, float)  # null is NaN
    error = numbers[:3].ravel()
    covariance = np.frombuffer(base64.b64decode(message["covariance"]), "<f4").reshape(9, 9)
    nees = np.nan
    if np.isfinite(error).all() and np.isfinite(covariance).all():
        nees = error @ np.linalg.pinv(covariance.astype(float)) @ error / len(error)
    times = time, message["time"], message["seen_at"]
    position = covariance[3:6, 3:6].ravel().tolist()
    rows["estimator"].append((*times, *numbers.ravel(), *position, float(nees)))
    rows["innovations"] += [
        (message["time"], each["marker"], np.nan if each["squared"] is None else each["squared"])
        for each in message["innovations"]
    ]


def _rotors(table):
    def read(rows, time, message):
        for number, joint in enumerate(message.joints, 1):
            rows[table].append((time, number, joint.velocity, joint.effort))

    return read


def _event(source):
    def read(rows, time, message):
        rows["events"].append((seconds(message.timestamp), source, message.name, message.message))

    return read


def _detections(rows, time, message):
    for m in message["markers"]:
        errors = m["reprojection_error"], m["ambiguity"]
        rows["detections"].append(
            (message["time"], time, m["id"], *m["position"], *m["orientation"], *errors)
        )
    for refused in message["refused"]:
        marker = -1 if refused["id"] is None else refused["id"]
        rows["refused"].append((message["time"], refused["reason"], marker))


def _map(rows, time, message):
    for m in message["statistics"]["markers"]:
        numbers = np.array([*m["mean"], *m["variance"]], float)  # null is NaN
        rows["map"].append((time, m["id"], *numbers, m["observations"], m["outliers"]))
    for gate in message["map"]["gates"]:
        heading = np.deg2rad(gate["heading_deg"])
        rows["gates"].append((time, gate["gate"], *gate["midpoint"], heading))


def _plan(rows, time, message):
    plan, lap = len(rows["plans"]) + 1, message["lap"]
    rows["plans"].append((plan, time, *(message.get(name, np.nan) for name in _PLAN)))
    gates = [*range(1, len(message["gate_times"])), 1]
    rows["plan_gates"] += [(plan, lap, *passed) for passed in zip(gates, message["gate_times"])]
    for part in ("entry", "circuit"):
        samples = zip(*(message[part][name] for name in PLAN_COLUMNS))
        rows["plan_samples"] += [
            (plan, lap, part, k * message["step"], *sample) for k, sample in enumerate(samples)
        ]


def _crossing(rows, time, message):
    rows["crossings"].append(tuple(message[name] for name in SIGNALS["crossings"]))


_READERS = {
    "/state/truth": _odometry("state"),
    "/state/estimate": _odometry("estimate"),
    "/state/filtered": _odometry("filtered"),
    "/state/disturbance": _vector("disturbance"),
    "/imu": _imu,
    "/imu/samples": _imu_samples,
    "/estimator": _estimator,
    "/reference": _odometry("reference"),
    "/reference/acceleration": _vector("reference_acceleration"),
    "/rotors/measured": _rotors("rotors"),
    "/rotors/command": _rotors("rotor_commands"),
    "/detections": _detections,
    "/map": _map,
    "/plan": _plan,
    "/explorer": _event("explorer"),
    "/referee": _event("referee"),
    "/referee/crossings": _crossing,
}
