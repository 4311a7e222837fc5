"""Distorted pictures are where K and D say, and maps draw boxes as they draw pictures."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.common.errors import UserError
from airrace.rendering.imaging.lens import Lens, PixelMap
from airrace.vehicle.camera_info import make_camera_info
from tests.worlds.pictures import CAMERA_INFO, new_picture

BARREL = (-0.25, 0.08, 0.001, -0.001, 0.0)
PINCUSHION = (0.08, -0.01, -0.001, 0.002, 0.001)
V, U = np.mgrid[:60, :80].astype(float)
# Turned, stretched, and bent outwards.
BENT = PixelMap(
    20 + 0.9 * U - 0.3 * V + 2e-3 * (U - 40) ** 2, 5 + 0.2 * U + 1.1 * V + 1e-3 * (V - 30) ** 2
)
SOURCE = np.random.default_rng(0).integers(0, 256, (110, 130), np.uint8)


def make_info(D, fov_y_deg=55.95):
    return make_camera_info(
        width=1280, height=720, fov_y=np.deg2rad(fov_y_deg), X_BC=CAMERA_INFO.X_BC, D=D
    )


@pytest.mark.slow
@pytest.mark.parametrize("D", [BARREL, PINCUSHION])
def test_points_are_where_opencv_projects_them(D):
    info = make_info(D)
    lens = Lens(info)
    pixels = np.array([[u, v] for u in (15.0, 400, 640, 900, 1264) for v in (15.0, 360, 704)])
    rays = cv2.undistortPoints(
        pixels[:, None], info.K, info.D, criteria=(cv2.TERM_CRITERIA_COUNT, 50, 0)
    )[:, 0]
    ideal = rays @ lens.pinhole.K[:2, :2].T + lens.pinhole.K[:2, 2]
    wide = np.zeros((lens.pinhole.height, lens.pinhole.width, 4), np.uint8)
    v, u = np.mgrid[: lens.pinhole.height, : lens.pinhole.width]
    for x, y in ideal:
        spot = np.exp(-((u - x) ** 2 + (v - y) ** 2) / 2 / 2.0**2)
        wide += np.uint8(np.round(250 * spot))[..., None]
    picture = new_picture()
    lens.distortion.bend(wide, picture)
    for u, v in pixels.astype(int):
        spot = picture[v - 10 : v + 11, u - 10 : u + 11, 0].astype(float)
        d = np.arange(-10, 11)
        centre = [spot.sum(axis=0) @ d, spot.sum(axis=1) @ d] / spot.sum()
        assert np.abs(centre).max() < 0.03


@pytest.mark.slow
def test_nothing_is_left_out():
    for D in (BARREL, PINCUSHION):
        lens = Lens(make_info(D))
        picture = new_picture()
        full = np.full((lens.pinhole.height, lens.pinhole.width, 4), 255, np.uint8)
        lens.distortion.bend(full, picture)
        assert np.all(picture == 255)


@pytest.mark.slow
def test_the_pinhole_picture_holds_all_that_the_lens_sees():
    pinhole = Lens(make_info(BARREL)).pinhole
    assert pinhole.width > 1280 and pinhole.height > 720
    assert not pinhole.D.any()
    assert pinhole.K[0, 0] == CAMERA_INFO.K[0, 0]
    assert np.array_equal(pinhole.P[:, :3], pinhole.K)
    assert Lens(make_info(PINCUSHION)).pinhole.width < 1280


@pytest.mark.slow
@pytest.mark.parametrize(
    "D, fov_y_deg",
    [
        ((-0.6, 0.0, 0.0, 0.0, 0.0), 55.95),
        ((0.0, 0.0, 0.0, 0.0, -3.0), 55.95),
        ((1e300, 1e300, 0.0, 0.0, 1e300), 55.95),
        ((-0.0035, 0.0, 0.0, 0.0, 0.0), 150),
        ((-0.12, 0.0066, 0.0, 0.0, 0.0), 75),
    ],
)
def test_impossible_lenses_are_refused(D, fov_y_deg):
    with pytest.raises(UserError, match="camera.effects.distortion folds .*smaller"):
        Lens(make_info(D, fov_y_deg))


@given(st.integers(0, 78), st.integers(0, 58), st.integers(1, 80), st.integers(1, 60))
def test_a_box_needs_no_more_than_its_source(x0, y0, w, h):
    box = x0, y0, min(x0 + w, 80), min(y0 + h, 60)
    whole, piece = np.zeros((60, 80), np.uint8), np.zeros((60, 80), np.uint8)
    BENT.bend(SOURCE, whole)
    a0, b0, a1, b1 = BENT.source(box, (130, 110))
    hidden = np.zeros_like(SOURCE)
    hidden[b0:b1, a0:a1] = SOURCE[b0:b1, a0:a1]
    BENT.bend(hidden, piece, box)
    inside = np.s_[box[1] : box[3], box[0] : box[2]]
    np.testing.assert_array_equal(piece[inside], whole[inside])
    piece[inside] = 0
    assert not piece.any()


def test_nothing_comes_from_beyond_the_source():
    aside = PixelMap(U - 200.0, V)
    picture = np.full((60, 80, 4), 7, np.uint8)
    aside.bend(np.full((60, 80, 4), 99, np.uint8), picture)
    assert np.all(picture == [0, 0, 0, 255])
    x0, y0, x1, y1 = aside.source((0, 0, 80, 60), (80, 60))
    assert x0 == x1
