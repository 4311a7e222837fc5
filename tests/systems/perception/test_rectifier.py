"""Rectified images are a pinhole camera's, and their calibration says so."""

import dataclasses as dc

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.math import RollPitchYaw, RotationMatrix
from pydrake.systems.sensors import ImageGrey8U, ImageRgba8U

from airrace.common.immutable import read_only
from airrace.rendering.imaging.lens import Lens
from airrace.rendering.planar.renderer import PlanarRenderer
from airrace.systems.perception.rectifier import Rectifier, rectified_info
from tests.worlds.pictures import (
    CAMERA_INFO,
    CORNERS_M,
    grey,
    look_at,
    measure_corners,
    new_picture,
    one_gate,
    project,
)

HARSH = dc.replace(CAMERA_INFO, D=read_only([-0.25, 0.08, 0.001, -0.001, 0.0]))


def rectify(picture, info, port="camera_image", kind=ImageRgba8U):
    """Returns image and info as they leave the system."""
    rectifier = Rectifier()
    context = rectifier.CreateDefaultContext()
    image = kind(info.width, info.height)
    image.mutable_data[:] = picture
    rectifier.GetInputPort(port).FixValue(context, Value(image))
    rectifier.GetInputPort("camera_info").FixValue(context, Value[object](info))
    outputs = [rectifier.GetOutputPort(name) for name in (port, "camera_info")]
    image, info = (port.Eval(context) for port in outputs)
    return image.data.copy(), info


def views(count):
    rng = np.random.default_rng(5)
    boards = one_gate().boards()
    while count:
        board = boards[rng.integers(4)]
        azimuth = rng.uniform(-0.7, 0.7)
        p_MC = rng.uniform(4, 12) * np.array([np.sin(azimuth), rng.uniform(-0.1, 0.3), 1.0])
        target = board.X_WM @ rng.uniform(-2.5, 2.5, 3)
        X_WC = look_at(board.X_WM @ p_MC, target, rng.uniform(-0.5, 0.5))
        corners, depth = project(CAMERA_INFO.K, X_WC, (board.X_WM @ CORNERS_M.T).T)
        if np.all(corners > 40) and np.all(corners < [1240, 680]) and np.all(depth > 1):
            count -= 1
            yield X_WC, corners


@pytest.mark.slow
def test_round_trip_of_corners():
    """Distorted and rectified, markers are where a pinhole camera shows them."""
    lens = Lens(HARSH)
    wide, ideal, raw = new_picture(lens.pinhole), new_picture(), new_picture()
    differences = []
    for X_WC, corners in views(12):
        PlanarRenderer(one_gate(), CAMERA_INFO).render(X_WC, ideal)
        PlanarRenderer(one_gate(), lens.pinhole).render(X_WC, wide)
        lens.distortion.bend(wide, raw)
        picture, info = rectify(raw, HARSH)
        assert np.all(picture[..., 3] == 255)
        assert np.array_equal(info.K, CAMERA_INFO.K) and not info.D.any()
        differences.append(
            measure_corners(grey(picture), corners) - measure_corners(grey(ideal), corners)
        )
    assert np.abs(differences).max() < 0.1
    assert np.abs(np.mean(differences, axis=(0, 1))).max() < 0.02


def test_an_ideal_camera_changes_nothing():
    picture = np.random.default_rng(0).integers(0, 255, (720, 1280, 4)).astype(np.uint8)
    picture[..., 3] = 255
    image, info = rectify(picture, CAMERA_INFO)
    assert np.array_equal(image, picture)
    assert np.array_equal(info.P, CAMERA_INFO.P)
    assert info.X_BC.IsExactlyEqualTo(CAMERA_INFO.X_BC)


def test_rectification_may_turn_the_camera():
    R = RotationMatrix(RollPitchYaw(0.02, -0.03, 0.05)).matrix()
    turned = dc.replace(CAMERA_INFO, R=read_only(R))
    X_WC, corners = next(views(1))
    X_WB = X_WC @ turned.X_BC.inverse()
    raw = new_picture()
    PlanarRenderer(one_gate(), CAMERA_INFO).render(X_WC, raw)
    picture, info = rectify(raw, turned)
    assert np.array_equal(info.R, np.eye(3))
    # The same marker, through the calibration of the rectified image.
    p_W = X_WC @ (np.linalg.inv(CAMERA_INFO.K) @ np.column_stack([corners, np.ones(4)]).T)
    expected, _ = project(info.K, X_WB @ info.X_BC, p_W.T)
    assert np.linalg.norm(expected - corners, axis=1).min() > 5
    measured = measure_corners(grey(picture), expected)
    assert np.abs(measured - expected).max() < 0.3


def test_what_the_lens_did_not_see_is_black():
    pincushion = dc.replace(CAMERA_INFO, D=read_only([0.3, 0.0, 0.0, 0.0, 0.0]))
    picture, _ = rectify(np.full((720, 1280, 4), 255, np.uint8), pincushion)
    assert picture[0, 0].tolist() == [0, 0, 0, 255]
    assert picture[360, 640].tolist() == [255, 255, 255, 255]


def test_new_focal_length_and_size_of_P():
    K = CAMERA_INFO.K * [[0.5], [0.5], [1.0]]
    info = dc.replace(CAMERA_INFO, P=read_only(np.column_stack([K, np.zeros(3)])))
    assert np.array_equal(rectified_info(info).K, K)
    X_WC, corners = next(views(1))
    raw = new_picture()
    PlanarRenderer(one_gate(), CAMERA_INFO).render(X_WC, raw)
    picture, _ = rectify(raw, info)
    small = corners / 2
    assert np.abs(measure_corners(grey(picture), small) - small).max() < 0.3


def test_grey_levels_are_rectified_as_colours_are():
    X_WC, _ = next(views(1))
    raw = new_picture()
    PlanarRenderer(one_gate(), CAMERA_INFO).render(X_WC, raw)
    colored, _ = rectify(raw, HARSH)
    levels, _ = rectify(grey(raw)[..., None], HARSH, "camera_grey", ImageGrey8U)
    difference = grey(colored).astype(int) - levels[..., 0]
    assert np.abs(difference).max() <= 2 and abs(difference.mean()) < 0.5


@pytest.mark.parametrize("port", ["camera_image", "camera_grey", "camera_info"])
def test_ports_have_the_names_of_the_cameras(port):
    assert Rectifier().HasInputPort(port) and Rectifier().HasOutputPort(port)
