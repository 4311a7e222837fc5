"""The observations of the environments: what a policy is shown.

- ``gates``: the drone's motion, and the openings of the next gates in its axes, of the truth; see
  write_gates_observation(), which the PolicyController uses, too.
- ``estimate``: the same from what the drone itself estimates, and with the map in the place of the
  track.
- ``pixels``: the camera's picture beside the drone's motion.

Numbers are in SI units and not scaled: who trains knows best how.
"""

import numpy as np

from airrace.systems.policy.gates_observation import (
    map_openings,
    observation_size,
    opening_numbers,
    write_gates_observation,
)
from airrace.track import GateMap, Track

__all__ = [
    "KINDS",
    "gates_of_map",
    "gates_of_track",
    "observation_size",
    "opening_numbers",
    "write_gates_observation",
]
KINDS = ("gates", "estimate", "pixels")


def gates_of_track(track: Track, shifts: np.ndarray | None = None) -> np.ndarray:
    """Returns the openings of a track's gates, (n, 15), see Opening.

    Args:
        track: with the true gates.
        shifts: x and y of each, by which it has moved (m), (2 n,).
    """
    gates = track.openings()
    if shifts is not None:
        gates[:, :2] += shifts.reshape(-1, 2)
    return gates


def gates_of_map(gate_map: GateMap) -> np.ndarray:
    """Returns the openings of a map's gates by their numbers, (n, 15); n is 0 while it is empty."""
    return map_openings(gate_map.gates)
