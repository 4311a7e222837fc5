"""The map on disk: map.json and map_statistics.json."""

from pathlib import Path

import numpy as np

from airrace.files import write_json
from airrace.systems.types import GateMap


def write_map(directory: Path, gate_map: GateMap) -> None:
    """Writes both files.

    Raises:
        UserError: if they cannot be written.
    """
    write_json(directory / "map.json", map_data(gate_map))
    write_json(directory / "map_statistics.json", statistics_data(gate_map))


def map_data(gate_map: GateMap) -> dict:
    """Returns the map as plain data: what a planner needs (m, degrees)."""
    return {
        "time_s": _time(gate_map),
        "gates": [
            {
                "gate": gate.number + 1,
                "midpoint": _rounded(gate.p_WG),
                "heading_deg": round(float(np.rad2deg(gate.heading)), 3),
                "spacing": round(float(gate.spacing), 4),
            }
            for gate in gate_map.gates
        ],
        "markers": [
            {"id": m.id, "position": _rounded(m.p_WM), "normal": _rounded(m.normal)}
            for m in gate_map.markers
        ],
    }


def statistics_data(gate_map: GateMap) -> dict:
    """Returns the statistics of section III of the Student AirRace report.

    And why markers were refused; of a board with no sightings, position and
    variance follow from the other boards of its gate.
    """
    return {
        "time_s": _time(gate_map),
        "detections": gate_map.detections,
        "out_of_range_ids": gate_map.out_of_range,
        "error_rate": gate_map.error_rate,
        "refused": gate_map.refused,
        "markers": [
            {
                "id": m.id,
                "sightings": m.count,
                "outliers": m.outliers,
                "mean": _rounded(m.p_WM),
                "variance": _rounded(m.variance, 6),
            }
            for m in gate_map.markers
        ],
    }


def _time(gate_map):
    """Returns the time of the newest image in the map (s), None before the first."""
    return gate_map.time if gate_map.time >= 0.0 else None


def _rounded(vector, digits=4):
    return [round(x, digits) for x in np.asarray(vector).tolist()]
