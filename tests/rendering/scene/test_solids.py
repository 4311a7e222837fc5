import cv2
import numpy as np
import pytest
from hypothesis import given

from airrace.rendering.scene.solids import (
    GATE_COLOR,
    GATE_SIDE_COLOR,
    LETTER_COLOR,
    Faces,
    gate_faces,
    room_faces,
    solids_of,
)
from airrace.track import load_track
from tests.worlds.square_gates import square_gates

COURSE = load_track("grand-prix")
HALL = COURSE.hall()


def areas(faces):
    a, b, c, d = np.moveaxis(faces.corners, 1, 0)
    return np.linalg.norm(np.cross(c - a, d - b), axis=1) / 2


@given(square_gates)
def test_faces_of_a_gate_are_flat_and_look_outwards(gate):
    every = gate_faces(gate)
    faces = Faces(*(part[:16] for part in every))
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
    assert areas(faces)[front].sum() == pytest.approx(2 * (2.72**2 - 1.5**2))
    assert areas(faces)[~np.array(front)].sum() == pytest.approx(4 * 0.26 * (2.72 + 1.5))
    # Letters lie on front and back, away from the middle, and within the frame's top.
    letters = Faces(*(part[16:] for part in every))
    assert len(letters.corners) == 20 and {tuple(c) for c in letters.colors} == {LETTER_COLOR}
    off = (letters.corners - gate.p_WG) @ gate.X_WG.rotation().matrix()
    side = np.sign(letters.normals @ gate.forward)
    np.testing.assert_allclose(off[..., 0], side[:, None] * np.full((1, 4), 0.138), atol=1e-6)
    assert np.all(np.abs(off[..., 1]) < 0.75) and np.all(
        (off[..., 2] > 0.76) & (off[..., 2] < 1.35)
    )


def test_gates_are_of_the_hue_that_clients_look_for():
    pixel = np.uint8([[GATE_COLOR, GATE_SIDE_COLOR]])
    hues = cv2.cvtColor(pixel[..., ::-1], cv2.COLOR_BGR2HSV)[0, :, 0]
    assert np.all((hues >= 3) & (hues <= 6))
    assert GATE_COLOR[::-1] == (6.0, 53.0, 251.0)  # BGR, as captured


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
    # A light is a bright rim around a dark middle, which hangs lower.
    light, panel = HALL.lights[0], HALL.panels[0]
    np.testing.assert_allclose(light.size[:2] - panel.size[:2], 0.16)
    assert panel.X_WB.translation()[2] < light.X_WB.translation()[2]
    assert len(others) == len(HALL.columns) + len(COURSE.gates)
