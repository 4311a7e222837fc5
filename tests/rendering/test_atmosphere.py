"""Haze grows with the distance, and the sky is that of the planar renderer."""

import numpy as np

from airrace.rendering.atmosphere import Atmosphere
from airrace.rendering.background import Background
from airrace.rendering.textures import HORIZON, haze
from tests.rendering.picture_tools import CAMERA_INFO, look_at, new_picture

X_WC = look_at([0.0, 0.0, 5.0], [20.0, 3.0, 6.0])
COLOR = np.array([100, 150, 50])


def looked_at(depth):
    picture = new_picture()
    picture[:] = (*COLOR, 255)
    depths = np.full(picture.shape[:2], depth, np.float32)
    Atmosphere(CAMERA_INFO).apply(X_WC, depths, picture)
    assert np.all(picture[..., 3] == 255)
    return picture[..., :3].astype(float)


def test_haze():
    for depth in (0.0, 10.0, 100.0, 500.0):
        picture = looked_at(depth)
        for u, v in ((640, 360), (0, 0), (1279, 719)):
            x, y = (u - 640) / CAMERA_INFO.K[0, 0], (v - 360) / CAMERA_INFO.K[1, 1]
            veil = haze(depth * np.sqrt(1 + x * x + y * y))
            expected = (1 - veil) * COLOR + veil * np.array(HORIZON)
            assert np.abs(picture[v, u] - expected).max() < 2


def test_where_there_is_nothing_there_is_sky():
    background = new_picture()
    Background(CAMERA_INFO).paint(X_WC, background)
    assert np.array_equal(looked_at(np.inf), background[..., :3])
