"""What follows from the signals of a race: laps, errors, angles."""

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from airrace.math.angles import wrap_angle
from airrace.recording.race_json import RaceJson
from airrace.track import Track

_STATES = ("state", "estimate", "filtered")
_BY_LAP = (*_STATES, "reference", "tracking", "rotors", "detections", "map", "disturbance")
_REFERENCE = ["time", "x", "y", "z", "yaw", "vx", "vy", "vz", "yaw_rate"]


def derive(signals: dict, result: RaceJson, track: Track) -> dict[str, pd.DataFrame]:
    """Returns all tables of a run.

    Args:
        signals: of read_signals().
        result: race.json.
        track: where the gates truly stood when the race began.
    """
    tables = dict(signals)
    for name in (*_STATES, "reference"):
        tables[name] = _in_world(tables[name])
    # Messages of one time have one number in their tables.
    acceleration = tables.pop("reference_acceleration")[["ax", "ay", "az"]]
    reference = tables["reference"].rename(columns={"wz": "yaw_rate"})
    reference["yaw"] = 2 * np.arctan2(reference["qz"], reference["qw"])  # also beyond 180 degrees
    reference = reference[_REFERENCE]
    tables["reference"] = reference.join(acceleration)
    tables["rotors"] = tables["rotors"].assign(command=tables.pop("rotor_commands")["speed"])
    tables["tracking"] = _tracking(tables["state"], reference)
    tables["map"] = _with_errors(tables["map"], track)
    tables["detections"]["range"] = np.linalg.norm(tables["detections"][["x", "y", "z"]], axis=1)
    tables["laps"] = _laps(result)
    starts = lap_starts(tables["crossings"])
    for name in _BY_LAP:
        # 0 is the exploration and the flight to gate 1.
        tables[name]["lap"] = np.searchsorted(starts, tables[name]["time"], side="right")
    return tables


def lap_starts(crossings: pd.DataFrame) -> np.ndarray:
    """Returns when gate 1 was crossed, each of which starts a lap or ends the last (s)."""
    return crossings["time"][crossings["gate"] == 1].to_numpy()


def _in_world(state: pd.DataFrame) -> pd.DataFrame:
    """Returns states with velocities in the world frame, Tait-Bryan angles (rad), and speed."""
    state = state.copy()
    q = state[["qw", "qx", "qy", "qz"]].to_numpy(copy=True)
    R_WB = Rotation.from_quat(q, scalar_first=True)
    for names in (["vx", "vy", "vz"], ["wx", "wy", "wz"]):
        state[names] = R_WB.apply(state[names].to_numpy(copy=True))
    state[["roll", "pitch", "yaw"]] = R_WB.as_euler("ZYX")[:, ::-1]
    state["speed"] = np.linalg.norm(state[["vx", "vy", "vz"]], axis=1)
    return state


def _tracking(state: pd.DataFrame, reference: pd.DataFrame) -> pd.DataFrame:
    """Returns by how much the drone was off its reference: x, y, z and distance (m), yaw (rad)."""
    off = (state[["x", "y", "z", "yaw"]] - reference[["x", "y", "z", "yaw"]]).dropna()
    yaw = off.pop("yaw")
    off.insert(0, "time", state["time"].reindex(off.index))  # an empty frame would take all
    off["distance"] = np.linalg.norm(off[["x", "y", "z"]], axis=1)
    off["yaw"] = wrap_angle(yaw)
    return off


def _with_errors(markers: pd.DataFrame, track: Track) -> pd.DataFrame:
    """Returns the map's markers with their gates and how far each is from where it is (m)."""
    truth = {board.id: board.X_WM.translation() for board in track.boards()}
    p_WM = np.array([truth.get(i, np.full(3, np.nan)) for i in markers["marker"]]).reshape(-1, 3)
    error = np.linalg.norm(markers[["x", "y", "z"]] - p_WM, axis=1)
    return markers.assign(error=error, gate=markers["marker"] // 4 + 1)


def _laps(result: RaceJson) -> pd.DataFrame:
    """Returns the laps of a race.json; NaN where there was no plan or map."""
    rows = [
        (
            *(lap["lap"], plan and plan["number"], lap["start_s"], lap["time_s"]),
            plan["duration_s"] if plan else np.nan,
            lap.get("waited_s", 0.0),
            *(lap["max_speed"], max(lap["gate_offsets_m"]), lap["map_rms_m"]),
        )
        for lap in result["laps"]
        for plan in (lap["plan"],)
    ]
    names = "lap plan start duration planned waited max_speed worst_offset map_rms"
    return pd.DataFrame(rows, columns=names.split()).astype({"plan": "Int64", "map_rms": float})
