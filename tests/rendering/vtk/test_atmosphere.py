"""Haze grows with the distance, and the sky is that of the planar renderer."""

import cv2
import numpy as np
import pytest

from airrace.rendering.planar.background import Background
from airrace.rendering.scene.textures import HAZE_MOST, HORIZON, haze
from airrace.rendering.vtk.atmosphere import Atmosphere
from tests.worlds.pictures import CAMERA_INFO, look_at, new_picture

X_WC = look_at([0.0, 0.0, 5.0], [20.0, 3.0, 6.0])
COLOR = np.array([100, 150, 50])
ALL = [(0, 0, CAMERA_INFO.width, CAMERA_INFO.height)]
SHAPE = CAMERA_INFO.height, CAMERA_INFO.width


def looked_at(depth, color=COLOR):
    bare, picture = new_picture(), new_picture()
    bare[:] = (*color, 255)
    depths = np.full(picture.shape[:2], depth, np.float32)
    grey = np.zeros(picture.shape[:2], np.uint8)
    Atmosphere(CAMERA_INFO).apply(X_WC, depths, bare, grey)
    Atmosphere(CAMERA_INFO).apply(X_WC, depths, bare, picture)
    assert np.all(picture[..., 3] == 255)
    # Drawn as such, it is up to rounding what OpenCV makes of the colours.
    expected = cv2.cvtColor(picture, cv2.COLOR_RGBA2GRAY).astype(int)
    assert np.abs(grey - expected).max() <= 2
    return picture[..., :3].astype(float)


@pytest.mark.slow
def test_haze():
    for depth in (0.0, 10.0, 100.0, 500.0):
        picture = looked_at(depth)
        for u, v in ((640, 360), (0, 0), (1279, 719)):
            x, y = (u - 640) / CAMERA_INFO.K[0, 0], (v - 360) / CAMERA_INFO.K[1, 1]
            veil = haze(depth * np.sqrt(1 + x * x + y * y))
            expected = (1 - veil) * COLOR + veil * np.array(HORIZON)
            assert np.abs(picture[v, u] - expected).max() < 2


@pytest.mark.parametrize("level", [0, 255])
def test_black_and_white_stay_in_range(level):
    for depth in (0.0, 1.0, 50.0, 1e4, 1e9):
        veil = HAZE_MOST if depth > 1e3 else haze(depth)
        middle = looked_at(depth, 3 * [level])[360, 640]
        np.testing.assert_allclose(middle, (1 - veil) * level + veil * np.array(HORIZON), atol=2)


def test_no_level_is_more_than_white():
    """All distances at once, finely: rounding must not carry white over to black."""
    picture = np.full((*SHAPE, 4), 255, np.uint8)
    depths = np.linspace(0.0, 5000.0, picture[..., 0].size, dtype=np.float32)
    out = new_picture()
    Atmosphere(CAMERA_INFO).apply(X_WC, depths.reshape(SHAPE), picture, out)
    assert out[..., :3].min() >= min(HORIZON) - 2


def test_things_before_the_sky_leave_it_as_it_is():
    background, picture = new_picture(), new_picture()
    Background(CAMERA_INFO).paint(background, ALL, [(1.0, X_WC)])
    black = np.zeros_like(picture)
    depths = np.full(SHAPE, 10.0, np.float32)
    depths[101:103, 7], depths[250, 600:700] = np.inf, np.inf
    Atmosphere(CAMERA_INFO).apply(X_WC, depths, black, picture)
    sky = np.isinf(depths)
    np.testing.assert_array_equal(picture[sky], background[sky])
    assert (picture[~sky][:, :3] < 100).all()  # black, in little haze


def test_where_there_is_nothing_there_is_sky():
    background = new_picture()
    Background(CAMERA_INFO).paint(background, ALL, [(1.0, X_WC)])
    assert np.array_equal(looked_at(np.inf), background[..., :3])
