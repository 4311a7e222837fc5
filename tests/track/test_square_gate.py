import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.track.square_gate import DEPTH, INNER, OUTER, SquareGate
from tests.worlds.square_gates import square_gates


def inside(box, p):
    return bool(np.all(np.abs(box.X_WB.inverse() @ p) <= box.size / 2 + 1e-9))


@given(square_gates)
def test_its_frame_is_right_handed_and_follows_the_flight(gate):
    forward, right = gate.forward, gate.rightward
    up = np.cross(right, forward)
    np.testing.assert_allclose(
        np.column_stack([forward, right, up]).T @ forward, [1, 0, 0], atol=1e-9
    )
    # The horizontal direction is the yaw, and a positive pitch leads down.
    assert forward[2] == pytest.approx(-np.sin(np.deg2rad(gate.pitch_deg)), abs=1e-9)
    yaw = np.deg2rad(gate.yaw_deg)
    flat = forward[:2] / np.linalg.norm(forward[:2])
    np.testing.assert_allclose(flat, [np.cos(yaw), np.sin(yaw)], atol=1e-9)
    assert right[2] == pytest.approx(0.0, abs=1e-9) and up[2] > 0.0


@given(square_gates, st.floats(0.1, 5.0))
def test_corners_are_a_square_in_its_plane(gate, side):
    corners = gate.corners(side)
    np.testing.assert_allclose(corners.mean(0), gate.p_WG, atol=1e-9)
    np.testing.assert_allclose((corners - gate.p_WG) @ gate.forward, 0.0, atol=1e-9)
    edges = np.roll(corners, -1, axis=0) - corners
    np.testing.assert_allclose(np.linalg.norm(edges, axis=1), side, atol=1e-9)
    # Clockwise for whoever is in front of the gate, from the upper left one.
    assert np.cross(edges[0], edges[1]) @ gate.forward > 0.0
    assert edges[0] @ gate.rightward == pytest.approx(side)


@given(square_gates, st.floats(-1.6, 1.6), st.floats(-1.6, 1.6), st.floats(-0.2, 0.2))
def test_its_boxes_are_the_frame_and_nothing_else(gate, y, z, x):
    """A point is in a box exactly if it is between both squares and both faces."""
    size = max(abs(y), abs(z))
    edges = [abs(size - INNER / 2), abs(size - OUTER / 2), abs(abs(x) - DEPTH / 2)]
    if min(edges) < 1e-6:
        return
    expected = INNER / 2 < size < OUTER / 2 and abs(x) < DEPTH / 2
    p = gate.X_WG @ np.array([x, y, z])
    assert any(inside(box, p) for box in gate.boxes().values()) == expected
    # They do not overlap either.
    assert sum(inside(box, p) for box in gate.boxes().values()) <= 1 or abs(z) == INNER / 2


def test_it_is_as_large_as_the_official_one():
    assert (OUTER, INNER, DEPTH) == (2.72, 1.5, 0.26)
    gate = SquareGate([1.0, 2.0, 3.0], yaw_deg=90.0)
    np.testing.assert_allclose(gate.p_WL, [1.0 - 1.36, 2.0, 3.0], atol=1e-12)
    np.testing.assert_allclose(gate.p_WR, [1.0 + 1.36, 2.0, 3.0], atol=1e-12)
    assert (gate.width, gate.height) == (2.72, 2.72)
