"""What follows from the signals of a race: laps, errors, angles."""

import numpy as np

from airrace.math.vec3 import columns as axes_of
from airrace.math.vec3 import sum3
from airrace.track import Track

_STATES = ("state", "estimate", "filtered")


def derive(signals: dict, result: dict, track: Track) -> dict:
    """Returns all tables of a run: {table: {column: array}}.

    Args:
        signals: of read_columns().
        result: race.json.
        track: where the gates truly stood when the race began.
    """
    tables = {name: dict(columns) for name, columns in signals.items()}
    for name in _STATES:
        _to_world(tables[name])
    reference, acceleration = tables["reference"], tables.pop("reference_acceleration")
    n = min(len(reference["time"]), len(acceleration["time"]))
    for name, column in reference.items():
        reference[name] = column[:n]
    reference |= {name: acceleration[name][:n] for name in ("ax", "ay", "az")}
    _add_commands(tables["rotors"], tables.pop("rotor_commands"))
    tables["tracking"] = tracking(tables["state"], reference)
    _add_errors(tables["map"], track)
    tables["detections"] |= {
        "range": np.sqrt(sum(np.square(tables["detections"][c], dtype=float) for c in "xyz"))
    }
    tables["laps"] = laps(result)
    starts = lap_starts(tables["crossings"])
    for name in (*_STATES, "reference", "tracking", "rotors", "detections", "map", "disturbance"):
        table = tables[name]
        # 0 is the exploration and the way to gate 1.
        table["lap"] = np.searchsorted(starts, table["time"].astype(float), side="right")
    return tables


def lap_starts(crossings: dict) -> np.ndarray:
    """Returns when gate 1 was crossed, each of which starts a lap or ends the last (s)."""
    return crossings["time"].astype(float)[crossings["gate"] == 1]


def laps(result: dict) -> dict:
    """Returns the laps of a race.json as columns; NaN where there was no plan or map."""

    def column(get):
        return np.array(
            [np.nan if (value := get(lap)) is None else value for lap in result["laps"]], float
        )

    plan = [lap["plan"] or {} for lap in result["laps"]]
    return {
        "lap": np.array([lap["lap"] for lap in result["laps"]], int),
        "start": column(lambda lap: lap["start_s"]),
        "duration": column(lambda lap: lap["time_s"]),
        "planned": np.array([p.get("duration_s", np.nan) for p in plan], float),
        "max_speed": column(lambda lap: lap["max_speed"]),
        "worst_offset": column(lambda lap: max(lap["gate_offsets_m"])),
        "map_rms": column(lambda lap: lap["map_rms_m"]),
    }


def _to_world(state: dict) -> None:
    """Turns the velocities of a table of states into the world frame; adds angles and speed."""
    if not len(state["time"]):
        state |= {name: np.array([]) for name in ("roll", "pitch", "yaw", "speed")}
        return
    w, x, y, z = (state[name] for name in ("qw", "qx", "qy", "qz"))
    axes = axes_of(w, x, y, z)
    for names in (("vx", "vy", "vz"), ("wx", "wy", "wz")):
        a, b, c = (state[name] for name in names)
        state |= dict(zip(names, sum3(a, axes[0], b, axes[1], c, axes[2])))
    state["roll"] = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    state["pitch"] = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    state["yaw"] = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    state["speed"] = np.sqrt(state["vx"] ** 2 + state["vy"] ** 2 + state["vz"] ** 2)


def _add_commands(rotors: dict, commands: dict) -> None:
    if not len(commands["time"]):
        return
    n = min(len(rotors["time"]), len(commands["time"]))  # a log may end between the two
    for name, column in rotors.items():
        rotors[name] = column[:n]
    rotors["command"] = commands["speed"][:n]


def tracking(state: dict, reference: dict) -> dict:
    """Returns by how much the drone was off its reference: x, y, z and distance (m)."""
    n = min(len(state["time"]), len(reference["time"]))
    off = {c: state[c][:n].astype(float) - reference[c][:n].astype(float) for c in "xyz"}
    yaw = state["yaw"][:n].astype(float) - reference["yaw"][:n].astype(float)
    return {
        "time": state["time"][:n],
        **off,
        "distance": np.sqrt(off["x"] ** 2 + off["y"] ** 2 + off["z"] ** 2),
        "yaw": np.arctan2(np.sin(yaw), np.cos(yaw)),
    }


def _add_errors(table: dict, track: Track) -> None:
    """Adds how far each marker of the map is from where it is (m)."""
    truth = {board.id: board.X_WM.translation() for board in track.boards()}
    nowhere = np.full(3, np.nan)
    positions = np.array([truth.get(int(i), nowhere) for i in table["marker"]]).reshape(-1, 3)
    mapped = np.column_stack([table[c].astype(float) for c in "xyz"])
    table["error"] = np.linalg.norm(mapped - positions, axis=1)
    table["gate"] = table["marker"].astype(int) // 4 + 1
