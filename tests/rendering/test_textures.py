"""Board images and the grass texture."""

import cv2
import numpy as np
import pytest

from airrace.rendering.textures import (
    BOARD_TEXELS,
    board_image,
    grass_detail,
    haze,
    marker_modules,
    sky_color,
)
from airrace.track import BOARD_SIZE, MARKER_SIZE


@pytest.mark.parametrize("size", [BOARD_TEXELS, 280, 105, 50])
def test_board_shows_its_marker(size):
    detector = cv2.aruco.ArucoDetector(
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_ARUCO_ORIGINAL)
    )
    # A margin and two pixels a texel make small pictures detectable.
    picture = cv2.copyMakeBorder(board_image(23, size), 20, 20, 20, 20, 0, value=128)
    picture = cv2.resize(picture, None, fx=2, fy=2)
    _, ids, _ = detector.detectMarkers(picture)
    assert np.ravel(ids).tolist() == [23]


@pytest.mark.parametrize("size", [BOARD_TEXELS, 420, 280, 210, 140, 105, 70, 35, 18])
def test_edges_stay_in_place_at_any_size(size):
    # The share of dark in a row through the black frame only.
    image = board_image(0, size).astype(float)
    row = image[int((0.15 + MARKER_SIZE / 14) / BOARD_SIZE * size)]
    dark = (row.max() - row) / (row.max() - 15.0)
    assert dark.sum() * BOARD_SIZE / size == pytest.approx(MARKER_SIZE, rel=0.01)
    centroid = (dark @ (np.arange(size) + 0.5)) / dark.sum()
    assert centroid == pytest.approx(size / 2, abs=0.02)


def test_marker_has_a_black_frame():
    modules = marker_modules(7)
    assert modules.shape == (7, 7)
    assert modules[1:-1, 1:-1].any()
    modules = modules.copy()
    modules[1:-1, 1:-1] = False
    assert not modules.any()


def test_grass_continues_over_its_borders():
    grass = grass_detail().astype(float)
    inside = np.abs(np.diff(grass, axis=0)).mean()
    across = np.abs(grass[0] - grass[-1]).mean()
    assert across == pytest.approx(inside, rel=0.2)
    assert grass.mean() == pytest.approx(128, abs=3)
    assert grass.std() > 30


def test_shared_pictures_cannot_be_changed():
    for picture in (board_image(1), board_image(1, 70), grass_detail()):
        with pytest.raises(ValueError):
            picture[0, 0] = 0


def test_haze_grows_with_distance_and_sky_is_paler_below():
    veil = haze(np.array([0.0, 10.0, 100.0, 1e6]))
    assert veil[0] == 0 and np.all(np.diff(veil) > 0) and veil[-1] < 1
    low, high = sky_color(np.array([0.0, 1.0]))
    assert low.sum() > high.sum()
