"""The blur has the length that optics predict, and its middle where the sample is."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from airrace.rendering.imaging.camera_effects import CameraEffects, ImagingChain
from airrace.rendering.imaging.motion_blur import Shutter, moved
from airrace.rendering.planar.renderer import PlanarRenderer
from tests.worlds.pictures import CAMERA_INFO, new_picture, one_gate, project, take_picture

F = CAMERA_INFO.K[0, 0]
SHUTTER = 0.004
SPOT = 3.0  # standard deviation of a drawn point (px)
STILL = np.zeros(3)


def draw_points(points):
    """Returns a renderer of bright spots at points in world."""

    def render(X_WC, out):
        out[:] = (0, 0, 0, 255)
        v, u = np.mgrid[: CAMERA_INFO.height, : CAMERA_INFO.width]
        for x, y in project(CAMERA_INFO.K, X_WC, points)[0]:
            low, high = max(int(y) - 40, 0), int(y) + 40
            spot = (u[low:high] - x) ** 2 + (v[low:high] - y) ** 2
            out[low:high, :, :3] += np.uint8(200 * np.exp(-spot / 2 / SPOT**2))[..., None]

    return render


def blurred_spot(point, w, v, X_WB=RigidTransform(), columns=slice(None)):
    """Returns the centre of a spot, and its variances without blur, [u, v] px."""
    chain = ImagingChain(effects=CameraEffects(shutter=SHUTTER), camera_info=CAMERA_INFO, seed=0)
    picture = new_picture()
    take_picture(
        chain, draw_points([point]), X_WB, np.array(w, float), np.array(v, float), 0, picture
    )
    light = picture[:, columns, 0].astype(float)
    light /= light.sum()
    rows, cols = np.arange(light.shape[0]), np.arange(light.shape[1])
    mean = np.array([light.sum(axis=0) @ cols, light.sum(axis=1) @ rows])
    square = np.array([light.sum(axis=0) @ cols**2, light.sum(axis=1) @ rows**2])
    return mean, square - mean**2 - (SPOT**2 - 0.35)  # uint8() cuts the spots' skirts off


# A uniform blur of length L has the variance L^2 / 12. Body x is the optical axis.
@pytest.mark.parametrize("w, v, length", [
    ([0, 0, 0], [0, 0, 0], [0, 0]),
    ([0, 0, 2.0], [0, 0, 0], [2.0 * F * SHUTTER, 0]),
    ([0, 5.0, 0], [0, 0, 0], [0, 5.0 * F * SHUTTER]),
    ([0, 0, 0], [0, 20, 0], [20 * F * SHUTTER / 10, 0]),
    ([0, 0, 0], [0, 0, -14], [0, 14 * F * SHUTTER / 10]),
    # Turning left moves things right, flying right moves them left.
    ([0, 0, 2.0], [0, 20, 0], [abs(20 / 10 + 2.0) * F * SHUTTER, 0]),
])  # fmt: skip
def test_length(w, v, length):
    mean, variance = blurred_spot([10.0, 0.0, 0.0], w, v)
    np.testing.assert_allclose(mean, [640, 360], atol=0.1)
    np.testing.assert_allclose(variance, np.square(length) / 12, rtol=0.05, atol=0.25)


def test_near_things_blur_more():
    """Parallax: at twice the distance, half the length."""
    _, near = blurred_spot([6.0, 0.0, 0.0], STILL, [0, 20, 0])
    _, far = blurred_spot([12.0, 0.0, 0.0], STILL, [0, 20, 0])
    assert np.sqrt(near[0] / far[0]) == pytest.approx(2.0, rel=0.05)


def test_blur_is_radial_in_forward_flight():
    """The focus of expansion stays sharp."""
    _, sharp = blurred_spot([10.0, 0.0, 0.0], STILL, [20, 0, 0])
    np.testing.assert_allclose(sharp, 0, atol=0.2)
    _, blurred = blurred_spot([10.0, -7.0, 0.0], STILL, [20, 0, 0])
    length = 20 * SHUTTER / 10 * F * 0.7
    np.testing.assert_allclose(blurred, [length**2 / 12, 0], rtol=0.05, atol=0.2)


def test_poses_are_symmetric_about_the_sample():
    shutter = Shutter(time=SHUTTER, camera_info=CAMERA_INFO)
    X_WB = RigidTransform(RollPitchYaw(0.1, -0.2, 2.0), [1.0, 2.0, 3.0])
    w, v = np.array([0.5, -1.0, 2.0]), np.array([10.0, -8.0, 3.0])
    poses = shutter.poses(X_WB, w, v)
    assert len(poses) > 1
    assert sum(weight for weight, _ in poses) == pytest.approx(1.0)
    middle = sum(weight * X_WC.translation() for weight, X_WC in poses)
    np.testing.assert_allclose(middle, X_WB.translation(), atol=1e-12)
    for weight, X_WC in poses:  # all within the time that it is open
        moved_by = X_WC.translation() - X_WB.translation()
        assert np.linalg.norm(moved_by) < np.linalg.norm(v) * SHUTTER / 2


def test_more_blur_takes_more_poses_up_to_a_limit():
    shutter = Shutter(time=SHUTTER, camera_info=CAMERA_INFO)
    counts = [
        len(shutter.poses(RigidTransform(), np.array([0, 0, w]), STILL))
        for w in (0.0, 0.1, 1.0, 3.0, 5.0, 100.0)
    ]
    assert counts[:2] == [1, 1]
    assert counts == sorted(counts) and 2 <= counts[2] < counts[4] <= counts[5] <= 6


def test_a_slow_camera_draws_the_ideal_picture():
    renderer = PlanarRenderer(one_gate(), CAMERA_INFO)
    chain = ImagingChain(effects=CameraEffects(shutter=SHUTTER), camera_info=CAMERA_INFO, seed=0)
    X_WB = RigidTransform(RollPitchYaw(0.0, 0.1, 0.1), [5.0, 0.0, 5.0])
    picture, ideal = new_picture(), new_picture()
    take_picture(
        chain, renderer.render, X_WB, np.array([0, 0, 0.05]), np.array([0.3, 0, 0]), 0, picture
    )
    renderer.render(X_WB @ CAMERA_INFO.X_BC, ideal)
    assert np.array_equal(picture, ideal)


def test_moved_follows_constant_velocities():
    X_WB = RigidTransform(RollPitchYaw(0.3, -0.4, 1.0), [1.0, 2.0, 3.0])
    w, v = np.array([0.3, -0.7, 1.1]), np.array([4.0, 5.0, 6.0])
    there = moved(X_WB, w, v, 0.5)
    np.testing.assert_allclose(there.translation(), [3.0, 4.5, 6.0])
    # Its rotation's rate is w, and going back ends where it began.
    R_dot = (moved(X_WB, w, v, 1e-6).rotation().matrix() - X_WB.rotation().matrix()) / 1e-6
    W = R_dot @ X_WB.rotation().matrix().T
    np.testing.assert_allclose([W[2, 1], W[0, 2], W[1, 0]], w, atol=1e-5)
    assert moved(there, w, v, -0.5).IsNearlyEqualTo(X_WB, 1e-12)
    assert moved(X_WB, STILL, v, 0.0).IsExactlyEqualTo(X_WB)
