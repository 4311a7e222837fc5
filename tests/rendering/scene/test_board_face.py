"""The faces of boards are the means over pixels that supersampling gives, too."""

import numpy as np
import pytest

from airrace.rendering.scene.board_face import (
    face_levels,
    find_samples,
    marker_crossings,
    modules_from_pixels,
)
from airrace.rendering.scene.textures import BLACK, WHITE, marker_modules
from airrace.track import MARKER_SIZE
from tests.worlds.pictures import CAMERA_INFO, look_at, one_gate

BOARD = one_gate().boards()[2]
FINE = 24  # samples of a pixel in either direction


def homography(X_WC):
    """Returns the map from (x, y, 1) of the board to homogeneous pixels."""
    X_CM = X_WC.inverse() @ BOARD.X_WM
    return CAMERA_INFO.K @ np.column_stack([X_CM.rotation().matrix()[:, :2], X_CM.translation()])


def drawn(H, box):
    to_modules, samples = np.empty((3, 3)), np.empty(2, np.int64)
    modules_from_pixels(H, to_modules)
    find_samples(to_modules, *(H[:2, 2] / H[2, 2]), samples)
    x0, y0, x1, y1 = box
    anchor, scratch = np.array([x0, (x0 + x1) / 2]), np.empty((5, x1 - x0), np.float32)
    crossings = marker_crossings(BOARD.id)
    return np.array(
        [
            face_levels(scratch, x1 - x0, to_modules, crossings, anchor, 0, y, samples).copy()
            for y in range(y0, y1)
        ]
    )


def supersampled(H, box):
    x0, y0, x1, y1 = box
    fine = (np.arange(FINE) + 0.5) / FINE - 0.5
    x, y = np.meshgrid(
        np.add.outer(np.arange(x0, x1), fine).ravel(), np.add.outer(np.arange(y0, y1), fine).ravel()
    )
    X, Y, W = np.tensordot(np.linalg.inv(H), np.stack([x, y, np.ones_like(x)]), 1)
    j = np.floor((X / W / MARKER_SIZE + 0.5) * 7).astype(int)
    i = np.floor((0.5 - Y / W / MARKER_SIZE) * 7).astype(int)
    white = np.pad(marker_modules(BOARD.id), 1, constant_values=True)
    share = white[np.clip(i + 1, 0, 8), np.clip(j + 1, 0, 8)]
    share = share.reshape(y1 - y0, FINE, x1 - x0, FINE).mean(axis=(1, 3))
    return BLACK + (WHITE - BLACK) * share


@pytest.mark.parametrize("distance, rms", [(4, 2.0), (10, 1.5), (25, 1.5), (50, 2.0), (150, 8.0)])
@pytest.mark.parametrize("roll", [0.0, 0.4, 2.5])
@pytest.mark.parametrize("azimuth", [0.0, -0.9])
def test_pixels_are_means_over_their_areas(distance, rms, roll, azimuth):
    p_M = distance * np.array([np.sin(azimuth), 0.1, np.cos(azimuth)])
    X_WC = look_at(BOARD.X_WM @ p_M, BOARD.X_WM.translation() + [0.0, 0.13, 0.07], roll)
    H = homography(X_WC)
    centre, half = H[:2, 2] / H[2, 2], 0.6 * CAMERA_INFO.K[0, 0] / distance + 3
    box = [*np.int64(centre - half), *np.int64(centre + half)]
    error = drawn(H, box) - supersampled(H, box)
    assert np.sqrt(np.mean(error**2)) < rms
    assert abs(error.mean()) < 0.5


def test_a_row_does_not_depend_on_where_it_starts():
    H = homography(look_at(BOARD.X_WM @ [1.0, 0.4, 9.0], BOARD.X_WM.translation(), 0.2))
    to_modules, scratch = np.empty((3, 3)), np.empty((5, 300), np.float32)
    modules_from_pixels(H, to_modules)
    rest = (to_modules, marker_crossings(BOARD.id), np.array([560.0, 640.0]))
    one = np.array([1, 1])
    whole = face_levels(scratch, 160, *rest, 0, 360, one).copy()
    np.testing.assert_array_equal(face_levels(scratch, 77, *rest, 41, 360, one), whole[41:118])
