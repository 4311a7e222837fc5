"""The signals of a race as columns of numbers: what the tables are made of.

SIGNALS says which there are. Everything is SI, in the world frame, angles in rad.
"""

import numpy as np

from airrace.analysis.log import read_log

_STATE = ("time", "x", "y", "z", "qw", "qx", "qy", "qz", "vx", "vy", "vz", "wx", "wy", "wz")
# Every table's columns, as the log has them; run.py adds `lap`, angles and errors.
SIGNALS = {
    "state": _STATE,  # the truth
    "estimate": _STATE,  # what the autonomy is handed
    "filtered": _STATE,  # what its controller uses
    "reference": ("time", "x", "y", "z", "yaw", "vx", "vy", "vz", "yaw_rate"),
    "reference_acceleration": ("time", "ax", "ay", "az"),
    "disturbance": ("time", "ax", "ay", "az"),
    "rotors": ("time", "rotor", "speed", "thrust"),
    "rotor_commands": ("time", "rotor", "speed"),
    "detections": (
        "time",
        "received",
        "marker",
        "x",
        "y",
        "z",
        "qw",
        "qx",
        "qy",
        "qz",
        "reprojection_error",
        "ambiguity",
    ),  # in the camera frame
    "refused": ("time", "reason", "marker"),
    "map": (
        "time",
        "marker",
        "x",
        "y",
        "z",
        "variance_x",
        "variance_y",
        "variance_z",
        "observations",
        "outliers",
    ),
    "gates": ("time", "gate", "x", "y", "z", "heading"),
    "plans": (
        "plan",
        "time",
        "lap",
        "start_time",
        "entry_duration",
        "phase",
        "duration",
        "solve_time",
        "max_speed",
        "max_acceleration",
        "max_rotor_thrust",
    ),
    "plan_gates": ("plan", "lap", "gate", "time"),  # on the circuit; at the end, gate 1 again
    "plan_samples": ("plan", "lap", "part", "time", "x", "y", "z", "vx", "vy", "vz", "yaw"),
    "events": ("time", "source", "name", "message"),
    "crossings": ("time", "lap", "gate", "offset", "max_speed"),
}


def read_columns(path, without=()) -> dict:
    """Returns the columns of all signals of a race.mcap: {table: {column: array}}.

    Args:
        path: the file.
        without: topics to leave out; their tables are empty.

    Raises:
        UserError: if it cannot be read.
    """
    rows = {name: [] for name in SIGNALS}
    for topic, time, message in read_log(path, [t for t in _READERS if t not in without]):
        _READERS[topic](rows, time, message)
    return {name: _as_columns(names, rows[name]) for name, names in SIGNALS.items()}


def empty_columns() -> dict:
    """Returns what read_columns() gives of a log without messages."""
    return {name: _as_columns(names, []) for name, names in SIGNALS.items()}


def _as_columns(names, rows) -> dict:
    columns = zip(*rows) if rows else [()] * len(names)
    return {name: _array(column) for name, column in zip(names, columns)}


def _array(column) -> np.ndarray:
    """Returns an array of numbers, NaN for what is missing; or of text."""
    array = np.array(column)
    if array.dtype == object and None in column:
        return np.array([np.nan if value is None else value for value in column])
    return array


def _seconds(stamp) -> float:
    return stamp.seconds + stamp.nanos / 1e9


def _read_state(name):
    def read(rows, time, message):
        p, q = message.pose.position, message.pose.orientation
        v, w = message.linear_velocity, message.angular_velocity
        rows[name].append(
            (
                _seconds(message.timestamp),
                p.x,
                p.y,
                p.z,
                q.w,
                q.x,
                q.y,
                q.z,
                v.x,
                v.y,
                v.z,
                w.x,
                w.y,
                w.z,
            )
        )

    return read


def _read_reference(rows, time, message):
    p, q = message.pose.position, message.pose.orientation
    v = message.linear_velocity
    yaw = 2 * np.arctan2(q.z, q.w)
    # The velocity is in a frame turned by the yaw.
    c, s = np.cos(yaw), np.sin(yaw)
    rows["reference"].append(
        (
            time,
            p.x,
            p.y,
            p.z,
            yaw,
            c * v.x - s * v.y,
            s * v.x + c * v.y,
            v.z,
            message.angular_velocity.z,
        )
    )


def _read_vector(name):
    def read(rows, time, message):
        rows[name].append((time, message.x, message.y, message.z))

    return read


def _read_rotors(rows, time, message):
    for i, joint in enumerate(message.joints, 1):
        rows["rotors"].append((time, i, joint.velocity, joint.effort))


def _read_commands(rows, time, message):
    for i, joint in enumerate(message.joints, 1):
        rows["rotor_commands"].append((time, i, joint.velocity))


def _read_detections(rows, time, message):
    for m in message["markers"]:
        rows["detections"].append(
            (
                message["time"],
                time,
                m["id"],
                *m["position"],
                *m["orientation"],
                m["reprojection_error"],
                m["ambiguity"],
            )
        )
    for refused in message["refused"]:
        marker = -1 if refused["id"] is None else refused["id"]
        rows["refused"].append((message["time"], refused["reason"], marker))


def _read_map(rows, time, message):
    for m in message["statistics"]["markers"]:
        rows["map"].append(
            (time, m["id"], *m["mean"], *m["variance"], m["observations"], m["outliers"])
        )
    for gate in message["map"]["gates"]:
        rows["gates"].append(
            (time, gate["gate"], *gate["midpoint"], np.deg2rad(gate["heading_deg"]))
        )


def _read_plan(rows, time, message):
    key = len(rows["plans"]) + 1, message["lap"]
    rows["plans"].append(
        (key[0], time, *(message.get(name, np.nan) for name in SIGNALS["plans"][2:]))
    )
    for i, when in enumerate(message["gate_times"]):
        gate = i + 1 if i + 1 < len(message["gate_times"]) else 1
        rows["plan_gates"].append((*key, gate, when))
    for part in ("entry", "circuit"):
        samples = message[part]
        for k, values in enumerate(zip(*(samples[c] for c in SIGNALS["plan_samples"][4:]))):
            rows["plan_samples"].append((*key, part, k * message["step"], *values))


def _read_event(source):
    def read(rows, time, message):
        rows["events"].append((_seconds(message.timestamp), source, message.name, message.message))

    return read


def _read_crossing(rows, time, message):
    rows["crossings"].append(tuple(message[name] for name in SIGNALS["crossings"]))


_READERS = {
    "/state/truth": _read_state("state"),
    "/state/estimate": _read_state("estimate"),
    "/state/filtered": _read_state("filtered"),
    "/state/disturbance": _read_vector("disturbance"),
    "/reference": _read_reference,
    "/reference/acceleration": _read_vector("reference_acceleration"),
    "/rotors/measured": _read_rotors,
    "/rotors/command": _read_commands,
    "/detections": _read_detections,
    "/map": _read_map,
    "/plan": _read_plan,
    "/explorer": _read_event("explorer"),
    "/referee": _read_event("referee"),
    "/referee/crossings": _read_crossing,
}
