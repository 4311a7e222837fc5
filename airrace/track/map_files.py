"""The map on disk: map.json, which can be read again, and map_statistics.json."""

import json
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from airrace.common.errors import UserError
from airrace.common.files import write_json
from airrace.track.course import Course
from airrace.track.gate_map import GateEstimate, GateMap, MarkerEstimate
from airrace.track.track_files import load_track

TRACK = "track"  # in place of a file: where the gates really are


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
    try:
        data = json.loads(Path(name).read_text(encoding="utf-8"))
        gates = [
            GateEstimate(
                number=int(gate["gate"]) - 1,
                p_WG=_finite(gate["midpoint"], (3,)),
                heading=np.deg2rad(float(_finite(gate["heading_deg"]))),
                spacing=float(_finite(gate["spacing"])),
            )
            for gate in data["gates"]
        ]
        markers = tuple(
            _known_marker(m["id"], _finite(m["position"], (3,)), _finite(m["normal"], (3,)))
            for m in data["markers"]
        )
    except OSError as e:
        raise UserError(
            f"The map {name} cannot be read ({e.strerror}); give the map.json of an earlier "
            f"race, or '{TRACK}'."
        ) from None
    except (ValueError, KeyError, TypeError):
        raise UserError(
            f"{name} is not a map: give the map.json of an earlier race, or '{TRACK}'."
        ) from None
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


def _finite(values: ArrayLike, shape: tuple[int, ...] = ()) -> np.ndarray:
    """Returns numbers of a file; raises ValueError unless they have a shape and are finite."""
    numbers = np.asarray(values, float)
    if numbers.shape != shape or not np.isfinite(numbers).all():
        raise ValueError
    return numbers
