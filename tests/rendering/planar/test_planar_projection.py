"""The planar renderer puts everything where the camera matrix says."""

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from airrace.rendering.planar.renderer import PlanarRenderer
from airrace.vehicle.camera_info import make_camera_info
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

TRACK = one_gate()
RENDERER = PlanarRenderer(TRACK, CAMERA_INFO)
BOARDS = TRACK.boards()


def view_of_board(board, distance, azimuth, elevation, aim, roll):
    """A pose in front of a board, aimed a bit off it, and the corners there."""
    p_MC = distance * np.array([
        np.sin(azimuth) * np.cos(elevation),
        np.sin(elevation),
        np.cos(azimuth) * np.cos(elevation),
    ])  # fmt: skip
    X_WC = look_at(board.X_WM @ p_MC, board.X_WM.translation())
    X_WC = X_WC @ RigidTransform(RotationMatrix(RollPitchYaw(aim[0], aim[1], roll)), [0, 0, 0])
    corners, depth = project(CAMERA_INFO.K, X_WC, (board.X_WM @ CORNERS_M.T).T)
    margin = 0.3 * np.ptp(corners)  # the whole board shall be in the picture
    inside = np.all(corners > margin) and np.all(corners < np.array([1280, 720]) - margin)
    return X_WC, corners, bool(inside and np.all(depth > 0.3))


def angle(degrees):
    return st.floats(-np.deg2rad(degrees), np.deg2rad(degrees))


def views(nearest, farthest, most_oblique):
    return st.builds(
        view_of_board,
        st.sampled_from(BOARDS),
        st.floats(nearest, farthest),
        angle(most_oblique),
        st.floats(np.deg2rad(-12), np.deg2rad(30)),
        st.tuples(angle(18), angle(25)),
        angle(180),
    )


@pytest.mark.slow
@given(views(3.0, 28.0, 60))
def test_edges_of_markers_are_unbiased(view):
    X_WC, corners, usable = view
    assume(usable)
    assume(np.min(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)) > 22)
    picture = new_picture()
    RENDERER.render(X_WC, picture)
    error = measure_corners(grey(picture), corners) - corners
    # Edges along rows or columns of pixels are the worst case.
    assert np.abs(error).max() < 0.3
    assert np.abs(error.mean(axis=0)).max() < 0.08
    # Not drawn in or out, which would make ranges long or short.
    centre = corners.mean(axis=0)
    outward = (corners - centre) / np.linalg.norm(corners - centre, axis=1)[:, None]
    assert abs(np.sum(error * outward, axis=1).mean()) < 0.08


@pytest.mark.slow
def test_edges_of_markers_are_precise_on_the_whole():
    rng = np.random.default_rng(3)
    errors = []
    while len(errors) < 40:
        X_WC, corners, usable = view_of_board(
            BOARDS[rng.integers(4)], rng.uniform(3, 25), rng.uniform(-1, 1),
            rng.uniform(-0.2, 0.4), rng.uniform(-0.3, 0.3, 2), rng.uniform(-3, 3),
        )  # fmt: skip
        if usable:
            picture = new_picture()
            RENDERER.render(X_WC, picture)
            errors.append(measure_corners(grey(picture), corners) - corners)
    errors = np.concatenate(errors)
    assert np.abs(errors.mean(axis=0)).max() < 0.01
    assert np.sqrt(np.mean(errors**2)) < 0.03


@pytest.mark.slow
@settings(max_examples=15)
@given(views(5.0, 20.0, 45))
def test_opencv_detects_markers_where_they_are(view):
    X_WC, corners, usable = view
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)
    assume(usable and edges.min() > 40)
    picture = new_picture()
    RENDERER.render(X_WC, picture)
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_ARUCO_ORIGINAL)
    found, ids, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(
        cv2.cvtColor(picture, cv2.COLOR_RGBA2GRAY)
    )
    assert ids is not None
    nearest = min(found, key=lambda quad: np.abs(quad[0] - corners).max())[0]
    # OpenCV pulls corners inwards by some tenths of a pixel, and misses one by
    # two pixels now and then.
    error = np.linalg.norm(nearest - corners, axis=1)
    assert np.median(error) < 1.0 and error.max() < 3.0


def test_principal_point_and_odd_sizes():
    # Sizes that do not divide by four, and far from 16:9.
    info = make_camera_info(width=333, height=501, fov_y=1.0, X_BC=CAMERA_INFO.X_BC)
    board = BOARDS[0]
    X_WC = look_at(board.X_WM @ [0.4, 0.3, 5.0], board.X_WM.translation(), roll=0.4)
    picture = new_picture(info)
    PlanarRenderer(TRACK, info).render(X_WC, picture)
    corners, _ = project(info.K, X_WC, (board.X_WM @ CORNERS_M.T).T)
    assert measure_corners(grey(picture), corners) == pytest.approx(corners, abs=0.1)


@pytest.mark.parametrize("distance", [60.0, 150.0, 400.0])
def test_tiny_boards_keep_their_place_and_brightness(distance):
    board = BOARDS[0]
    X_WC = look_at(board.X_WM @ [1.0, 0.4, distance], board.X_WM.translation(), roll=0.3)
    picture = new_picture()
    RENDERER.render(X_WC, picture)
    # The same scene without boards is the background to compare with.
    without = new_picture()
    renderer = PlanarRenderer(TRACK, CAMERA_INFO)
    posts = renderer._posts
    renderer._posts = posts._replace(p_FM_W=posts.p_FM_W - [0.0, 0.0, 1e6])
    renderer.render(X_WC, without)
    half = int(3 + 0.8 * CAMERA_INFO.K[0, 0] / distance)
    region = np.s_[360 - half : 361 + half, 640 - half : 641 + half]
    # Red is as bright as 232 to 242 in the pylon behind, so blue is used.
    board_blue, other_blue = picture[region][..., 2] + 0.0, without[region][..., 2] + 0.0
    changed = np.abs(board_blue - other_blue)
    v, u = np.mgrid[-half : half + 1, -half : half + 1]
    centre = np.array([(changed * u).sum(), (changed * v).sum()]) / changed.sum()
    size = 1.5 * CAMERA_INFO.K[0, 0] / distance
    assert np.abs(centre).max() < 0.1 * size + 0.3
    assert (changed > 10).sum() == pytest.approx(size**2, abs=4 * size + 4)
