"""The map on disk: map.json and map_statistics.json."""

import numpy as np

from airrace.systems.types import GateMap


def map_data(gate_map: GateMap) -> dict:
    """Returns the map as plain data: what a planner needs (m, degrees)."""
    return {
        "time_s": gate_map.time,
        "gates": [
            {
                "gate": gate.number + 1,
                "midpoint": _rounded(gate.p_WG),
                "heading_deg": round(float(np.rad2deg(gate.heading)), 3),
            }
            for gate in gate_map.gates
        ],
        "markers": [
            {"id": m.id, "position": _rounded(m.p_WM), "normal": _rounded(m.normal)}
            for m in gate_map.markers
        ],
    }


def statistics_data(gate_map: GateMap) -> dict:
    """Returns the statistics of section III of the Student AirRace report."""
    return {
        "time_s": gate_map.time,
        "detections": gate_map.detections,
        "out_of_range_ids": gate_map.out_of_range,
        "error_rate": gate_map.error_rate,
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


def _rounded(vector, digits=4):
    return [round(x, digits) for x in np.asarray(vector).tolist()]
