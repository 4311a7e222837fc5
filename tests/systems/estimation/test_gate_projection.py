import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.systems.estimation import gate_projection as gp
from airrace.systems.estimation.error_state import corrected
from airrace.systems.estimation.navigation import as_navigation
from airrace.track import Gate
from tests.systems.estimation.motions import CAMERA, navigation, numerical, vectors

gates = st.tuples(
    st.floats(10, 30), st.floats(-3, 3), st.floats(5, 7), st.floats(-0.7, 0.7), st.floats(8, 12)
).map(np.array)


@pytest.mark.parametrize("id", range(4))
def test_corners_are_where_the_track_has_them(id):
    gate = Gate(left_pylon=[3.0, -4.0], heading_deg=33.0)
    state = np.array([*gate.p_WG, gate.heading, gate.pylon_spacing])
    corners, _ = gp.corner_positions(state, id)
    X_WM, half = gate.boards(0)[id].X_WM, 0.6
    expected = [
        X_WM @ [x, y, 0.0] for x, y in ((-1, 1), (1, 1), (1, -1), (-1, -1)) * np.array(half)
    ]
    np.testing.assert_allclose(corners, expected, atol=1e-9)


@given(vectors, gates, st.integers(0, 3))
def test_derivatives_of_the_pixels(turn, gate, id):
    state = as_navigation(navigation(0.1 * turn))

    def by_pose(e):
        error = np.concatenate([e, np.zeros(9)])
        return gp.predicted_corners(corrected(state, error), gate, id, CAMERA)[0]

    def by_gate(e):
        return gp.predicted_corners(state, gate + e, id, CAMERA)[0]

    _, J_pose, J_gate, depth = gp.predicted_corners(state, gate, id, CAMERA)
    assert depth > 0.0
    np.testing.assert_allclose(J_pose, numerical(by_pose, 6), rtol=1e-5, atol=1e-3)
    np.testing.assert_allclose(J_gate, numerical(by_gate, 5), rtol=1e-5, atol=1e-3)


def test_a_board_behind_the_camera_has_no_depth():
    gate = np.array([-20.0, 0.0, 6.25, 0.0, 10.0])
    assert gp.predicted_corners(as_navigation(navigation()), gate, 0, CAMERA)[3] < 0.0
