"""The faces of boards are the means over pixels that supersampling gives, too."""

import types

import numpy as np
import pytest

from airrace.rendering.planar.marker_face import FACE, face_levels, marker_crossings, set_face
from airrace.rendering.scene.textures import BLACK, WHITE, marker_modules
from airrace.track import MARKER_SIZE
from tests.worlds.cases import first
from tests.worlds.pictures import CAMERA_INFO, look_at, one_gate

BOARD = one_gate().boards()[2]


def homography(X_WC):
    """Returns the map from (x, y, 1) of the board to homogeneous pixels."""
    X_CM = X_WC.inverse() @ BOARD.X_WM
    return CAMERA_INFO.K @ np.column_stack([X_CM.rotation().matrix()[:, :2], X_CM.translation()])


def make_face(H, first, middle):
    """Returns a FACE, filled in Python: to compile what fills it takes seconds."""
    parts = types.SimpleNamespace(
        to_modules=np.empty((3, 3)), crossings=np.empty(8, np.int32), samples=np.empty(2, np.int64)
    )
    set_face(parts, H, marker_crossings(BOARD.id), first, middle)
    face = np.zeros(1, FACE)[0]
    for name, values in vars(parts).items():
        face[name] = values
    return face


def drawn(H, box):
    x0, y0, x1, y1 = box
    face, scratch = make_face(H, x0, (x0 + x1) / 2), np.empty((5, x1 - x0), np.float32)
    return np.array([face_levels(face, x0, x1, y, scratch).copy() for y in range(y0, y1)])


def supersampled(H, box, count):
    """Args: count: samples of a pixel in either direction."""
    x0, y0, x1, y1 = box
    fine = (np.arange(count) + 0.5) / count - 0.5
    x, y = np.meshgrid(
        np.add.outer(np.arange(x0, x1), fine).ravel(), np.add.outer(np.arange(y0, y1), fine).ravel()
    )
    X, Y, W = np.tensordot(np.linalg.inv(H), np.stack([x, y, np.ones_like(x)]), 1)
    j = np.floor((X / W / MARKER_SIZE + 0.5) * 7).astype(int)
    i = np.floor((0.5 - Y / W / MARKER_SIZE) * 7).astype(int)
    white = np.pad(marker_modules(BOARD.id), 1, constant_values=True)
    share = white[np.clip(i + 1, 0, 8), np.clip(j + 1, 0, 8)]
    share = share.reshape(y1 - y0, count, x1 - x0, count).mean(axis=(1, 3))
    return BLACK + (WHITE - BLACK) * share


@pytest.mark.slow
@pytest.mark.parametrize("distance, rms", [(4, 2.0), (10, 1.5), (25, 1.5), (50, 2.0), (150, 8.0)])
@pytest.mark.parametrize("roll", first([0.4, 0.0, 2.5]))
@pytest.mark.parametrize("azimuth", first([-0.9, 0.0]))
def test_pixels_are_means_over_their_areas(distance, rms, roll, azimuth):
    p_M = distance * np.array([np.sin(azimuth), 0.1, np.cos(azimuth)])
    X_WC = look_at(BOARD.X_WM @ p_M, BOARD.X_WM.translation() + [0.0, 0.13, 0.07], roll)
    H = homography(X_WC)
    centre, half = H[:2, 2] / H[2, 2], 0.6 * CAMERA_INFO.K[0, 0] / distance + 3
    box = [*np.int64(centre - half), *np.int64(centre + half)]
    error = drawn(H, box) - supersampled(H, box, 12 if distance < 20 else 24)
    assert np.sqrt(np.mean(error**2)) < rms
    assert abs(error.mean()) < 0.5


@pytest.mark.slow
def test_a_row_does_not_depend_on_where_it_starts():
    H = homography(look_at(BOARD.X_WM @ [1.0, 0.4, 9.0], BOARD.X_WM.translation(), 0.2))
    face, scratch = make_face(H, 560.0, 640.0), np.empty((5, 300), np.float32)
    face["samples"] = 1
    whole = face_levels(face, 560, 720, 360, scratch).copy()
    np.testing.assert_array_equal(face_levels(face, 601, 678, 360, scratch), whole[41:118])
