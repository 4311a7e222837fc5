"""Gates as observations have them: of the track, moved, and of the map."""

import numpy as np

from airrace.envs.observation import gates_of_map, gates_of_track
from airrace.track import GateEstimate, GateMap, load_track

TRACK = load_track("hexagon")


def test_gates_that_have_moved():
    shifts = np.arange(2.0 * len(TRACK.gates))
    moved = gates_of_track(TRACK, shifts)
    np.testing.assert_allclose(moved, gates_of_track(TRACK.shifted(shifts)), atol=1e-9)


def test_a_perfect_map_is_the_track():
    gates = tuple(
        GateEstimate(n, gate.p_WG, gate.heading, gate.pylon_spacing)
        for n, gate in enumerate(TRACK.gates)
    )
    of_map = gates_of_map(GateMap(gates=gates))
    np.testing.assert_allclose(of_map, gates_of_track(TRACK), atol=1e-12)


def test_an_empty_map():
    assert gates_of_map(GateMap()).shape == (0, 15)
