import numpy as np
import pytest
from hypothesis import given

from airrace.rendering.scene.solids import GATE_COLOR, gate_faces, room_faces, solids_of
from airrace.track import load_track
from tests.worlds.square_gates import square_gates

COURSE = load_track("grand-prix")
HALL = COURSE.hall()


def areas(faces):
    a, b, c, d = np.moveaxis(faces.corners, 1, 0)
    return np.linalg.norm(np.cross(c - a, d - b), axis=1) / 2


@given(square_gates)
def test_faces_of_a_gate_are_flat_and_look_outwards(gate):
    faces = gate_faces(gate)
    assert len(faces.corners) == 16
    for corners, normal in zip(faces.corners, faces.normals):
        np.testing.assert_allclose((corners - corners[0]) @ normal, 0.0, atol=1e-6)
        # A step along the normal leaves the frame, a step back enters it.
        middle = corners.mean(0)
        for step, is_inside in ((0.05, False), (-0.05, True)):
            p = middle + step * normal
            inside = [
                np.all(np.abs(box.X_WB.inverse() @ p) <= box.size / 2)
                for box in gate.boxes().values()
            ]
            assert any(inside) == is_inside
    # Front and back are the frame's area each; outside and inside are the squares' sides.
    front = [tuple(color) == GATE_COLOR for color in faces.colors]
    assert areas(faces)[front].sum() == pytest.approx(2 * (2.7**2 - 1.5**2))
    assert areas(faces)[~np.array(front)].sum() == pytest.approx(4 * 0.26 * (2.7 + 1.5))


def test_a_room_is_closed_and_seen_from_inside():
    faces = room_faces(HALL)
    x, y, z = HALL.high - HALL.low
    assert areas(faces).sum() == pytest.approx(2 * (x * y + y * z + z * x))
    middle = (HALL.low + HALL.high) / 2
    to_middle = middle - faces.corners[:, 0]
    assert np.all(np.einsum("ij,ij->i", to_middle, faces.normals) > 0.0)


def test_a_hall_is_behind_its_columns_and_gates():
    behind, others = solids_of(COURSE)
    assert len(behind) == 1 + len(HALL.lights)
    assert len(others) == len(HALL.columns) + len(COURSE.gates)
