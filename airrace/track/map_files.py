"""The map on disk: map.json, which can be read again, and map_statistics.json."""

from pathlib import Path
from typing import TypedDict

import numpy as np

from airrace.common.errors import UserError
from airrace.common.files import write_json
from airrace.common.json_files import read_json
from airrace.track.course import Course
from airrace.track.gate_map import GateEstimate, GateMap, MarkerEstimate
from airrace.track.track_files import load_track

TRACK = "track"  # in place of a file: where the gates really are
_FARTHEST, _WIDEST = 1e7, 100.0  # m, of a map that is read: coordinates, spacing of pylons


class GateJson(TypedDict):
    """A gate of map.json."""

    gate: int  # from 1
    midpoint: list[float]  # (m)
    heading_deg: float
    spacing: float  # of its pylons (m)


class MarkerJson(TypedDict):
    """A marker of map.json."""

    id: int
    position: list[float]  # (m)
    normal: list[float]


class MapJson(TypedDict):
    """map.json, as far as it is read again."""

    gates: list[GateJson]
    markers: list[MarkerJson]


def write_map(directory: Path, gate_map: GateMap) -> None:
    """Writes both files; raises UserError if they cannot be written."""
    write_json(directory / "map.json", map_data(gate_map))
    write_json(directory / "map_statistics.json", statistics_data(gate_map))


def map_data(gate_map: GateMap) -> dict:
    """Returns the map as plain data: what a planner needs (m, degrees).

    Its time is that of the newest image in it (s), None before the first.
    """
    return {
        "time_s": gate_map.time if gate_map.time >= 0.0 else None,
        "gates": [
            {
                "gate": gate.number + 1,
                "midpoint": rounded(gate.p_WG),
                "heading_deg": round(float(np.rad2deg(gate.heading)), 3),
                "spacing": round(float(gate.spacing), 4),
            }
            for gate in gate_map.gates
        ],
        "markers": [
            {"id": m.id, "position": rounded(m.p_WM), "normal": rounded(m.normal)}
            for m in gate_map.markers
        ],
    }


def statistics_data(gate_map: GateMap) -> dict:
    """Returns the statistics of section III of the Student AirRace paper.

    And why markers were refused. The detections of a marker are its observations, which count,
    and its outliers. Of a board with no observations, position and variance follow from the
    other boards of its gate.
    """
    return {
        "time_s": gate_map.time if gate_map.time >= 0.0 else None,
        "detections": gate_map.detections,
        "out_of_range_ids": gate_map.out_of_range,
        "error_rate": gate_map.error_rate,
        "error_rate_percent": 100.0 * gate_map.error_rate,
        "outliers": sum(m.outliers for m in gate_map.markers),
        "refused": gate_map.refused,
        "markers": [
            {
                "id": m.id,
                "detections": m.count + m.outliers,
                "observations": m.count,
                "outliers": m.outliers,
                "mean": rounded(m.p_WM),
                "variance": rounded(m.variance, 6),
            }
            for m in gate_map.markers
        ],
    }


def rounded(vector: np.ndarray, digits: int = 4) -> list:
    """Returns a vector's numbers, rounded; of a few, quicker than numpy's."""
    return [round(x, digits) for x in np.asarray(vector).tolist()]


def read_map(name: str, track_name: str) -> GateMap:
    """Returns the map of a scenario; name: TRACK, or the map.json of an earlier race.

    Raises UserError if there is no such map.
    """
    if name == TRACK:
        return true_map(load_track(track_name, markers=True))
    remedy = f"give the map.json of an earlier race, or '{TRACK}'"
    data = read_json(Path(name), MapJson, "map", remedy)
    gates = [
        GateEstimate(
            number=gate["gate"] - 1,
            p_WG=np.array(gate["midpoint"], float),
            heading=np.deg2rad(gate["heading_deg"]),
            spacing=float(gate["spacing"]),
        )
        for gate in data["gates"]
    ]
    markers = tuple(
        _known_marker(each["id"], np.array(each["position"]), np.array(each["normal"]))
        for each in data["markers"]
    )
    vectors = [gate.p_WG for gate in gates] + [v for m in markers for v in (m.p_WM, m.normal)]
    if not all(v.shape == (3,) and np.abs(v).max() <= _FARTHEST for v in vectors):
        raise UserError(
            f"{name} is no map: a vector must be three numbers up to 10,000 km; {remedy}."
        )
    if not all(0.0 < gate.spacing <= _WIDEST for gate in gates):
        raise UserError(f"{name} is no map: a spacing must be above 0 and at most 100 m; {remedy}.")
    numbers = [gate.number for gate in gates]
    if len(gates) < 2 or sorted(numbers) != list(range(len(gates))):
        raise UserError(
            f"The map {name} must have all gates, two or more; it has "
            f"{', '.join(str(n + 1) for n in numbers) or 'none'}."
        )
    return GateMap(gates=tuple(sorted(gates, key=lambda gate: gate.number)), markers=markers)


def true_map(track: Course) -> GateMap:
    """Returns the map that perfect observations would make."""
    return GateMap(
        gates=tuple(
            GateEstimate(number=n, p_WG=gate.p_WG, heading=gate.heading, spacing=gate.width)
            for n, gate in enumerate(track.gates)
        ),
        markers=tuple(
            _known_marker(board.id, board.X_WM.translation(), board.X_WM.rotation().matrix()[:, 2])
            for board in track.boards()
        ),
    )


def _known_marker(id: int, p_WM: np.ndarray, normal: np.ndarray) -> MarkerEstimate:
    """Returns a marker whose position is exact."""
    return MarkerEstimate(int(id), 1, 0, p_WM, np.zeros(3), normal)
