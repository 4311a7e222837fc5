"""What the planar renderer shows and what it hides."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw

from airrace.rendering.images import Box
from airrace.rendering.planar.projection import NEAR, View
from airrace.rendering.planar.pylons import pylon_box
from airrace.rendering.planar.renderer import PlanarRenderer
from airrace.rendering.scene.textures import BOARD_BACK, EARTH
from airrace.track import Gate, Track, load_track
from tests.worlds.pictures import CAMERA_INFO, R_BC, look_at, new_picture, one_gate, project

GATE = one_gate()
AWAY = Track(gates=[Gate(left_pylon=[-1e6, 0.0], heading_deg=0.0)])  # out of sight


def draw(track, X_WC):
    picture = new_picture()
    PlanarRenderer(track, CAMERA_INFO).render(X_WC, picture)
    assert np.all(picture[..., 3] == 255)
    return picture


def body_pose(roll, pitch, yaw, p_WB):
    return RigidTransform(RollPitchYaw(roll, pitch, yaw), p_WB) @ RigidTransform(R_BC, [0, 0, 0])


def is_dark(picture, pixel):
    u, v = np.round(pixel).astype(int)
    return picture[v, u, :3].mean() < 40


@pytest.mark.slow
@pytest.mark.parametrize("roll", np.deg2rad([-150.0, -60.0, -20.0, 0.0, 45.0, 90.0, 180.0]))
@pytest.mark.parametrize("pitch", np.deg2rad([-15.0, 0.0, 12.0]))
def test_horizon(roll, pitch):
    X_WC = body_pose(roll, pitch, 0.3, [0.0, 0.0, 6.0])
    picture = draw(AWAY, X_WC).astype(int)
    u, v = np.meshgrid(np.arange(1280), np.arange(720))
    rays = np.stack([u, v, np.ones_like(u)], -1) @ np.linalg.inv(CAMERA_INFO.K).T
    rays /= np.linalg.norm(rays, axis=2)[..., None]
    elevation = np.arcsin(rays @ X_WC.rotation().matrix()[2])
    is_sky = picture[..., 2] > picture[..., 1]
    # The ground fades out over the last metres before the horizon.
    assert np.all(is_sky[elevation > 0.01])
    assert not np.any(is_sky[elevation < -0.03])


def test_ground_texture_is_fixed_to_the_world():
    # Seen from straight above, a step moves the picture by whole pixels.
    height = 20.0
    down = body_pose(0.0, np.pi / 2, 0.0, [3.0, -7.0, height])
    step = 40 * height / CAMERA_INFO.K[0, 0]  # of 40 pixels
    ahead = RigidTransform(down.rotation(), down.translation() + [step, 0.0, 0.0])
    first, second = (draw(AWAY, X)[..., :3].astype(int) for X in (down, ahead))
    # Body x is up in this picture: what was at row v appears 40 rows lower.
    assert first.std() > 5
    assert np.abs(second[40:] - first[:-40]).max() <= 3


def test_back_of_a_board_shows_no_marker():
    front, back = GATE.boards()[0], GATE.boards()[1]
    X_WC = look_at([10.0, 9.0, 6.25], [20.0, 5.0, 6.25])
    picture = draw(GATE, X_WC)
    # The back board sticks out behind the pylon.
    u, v = np.round(project(CAMERA_INFO.K, X_WC, [back.X_WM @ [0.7, 0.0, 0.0]])[0][0]).astype(int)
    assert picture[v, u, :3] == pytest.approx(np.array(BOARD_BACK), abs=3)
    pixel = project(CAMERA_INFO.K, X_WC, [front.X_WM @ [-0.5, 0.5, 0.0]])[0][0]
    assert is_dark(picture, pixel)


def test_nearer_pylon_hides_a_board():
    near = Gate(left_pylon=[20.0, 5.0], heading_deg=0.0)
    far = Gate(left_pylon=[40.0, 5.0], heading_deg=0.0)
    far_board = far.boards(0)[0].X_WM @ [-0.5, 0.5, 0.0]  # black
    alone = Track(gates=[far])
    # From the first two poses the near left pylon stands in the way, low and
    # high; from the third it does not.
    for p_WC, hidden in (
        ([10.0, 5.0, 3.0], True),
        ([5.0, 5.1, 3.5], True),
        ([10.0, 0.0, 4.0], False),
    ):
        X_WC = look_at(p_WC, far_board)
        assert is_dark(draw(alone, X_WC), [640, 360])
        for gates in ([near, far], [far, near]):
            assert is_dark(draw(Track(gates=gates), X_WC), [640, 360]) != hidden


def test_nearer_board_covers_pylon():
    board = GATE.boards()[0]
    p_W = board.X_WM @ [-0.5, 0.0, 0.0]
    assert is_dark(draw(GATE, look_at([12.0, 4.0, 6.0], p_W)), [640, 360])


def test_nothing_is_drawn_from_behind_the_camera():
    for p_WC in ([22.0, 0.0, 6.0], [21.5, 4.0, 6.25], [60.0, 0.0, 2.0]):
        X_WC = look_at(p_WC, [1000.0, 0.0, 6.0], roll=0.2)
        assert np.array_equal(draw(GATE, X_WC), draw(AWAY, X_WC))


def test_boards_cut_by_the_camera_plane():
    board = GATE.boards()[0]
    # A hand's breadth before the board and looking along it: half of the
    # board is behind the camera.
    X_WC = look_at(board.X_WM @ [0.3, 0.0, 0.1], board.X_WM @ [5.0, 0.0, 0.1])
    picture = draw(GATE, X_WC)
    # The board is to the left here (its face looks to the right of the view).
    left = picture[300:420, :300, :3].astype(int)
    right = picture[300:420, -300:, :3]
    assert np.all(np.ptp(left, axis=2) < 3)  # grey: a board
    assert np.array_equal(right, draw(AWAY, X_WC)[300:420, -300:, :3])


def test_inside_a_pylon_and_below_the_ground():
    inside = draw(GATE, body_pose(0, 0, 0, [20.0, 5.0, 4.0]))
    assert np.ptp(inside.reshape(-1, 4), axis=0).max() == 0
    below = draw(GATE, body_pose(0, -0.5, 0, [0.0, 0.0, -0.1]))
    assert np.all(below[..., :3] == EARTH)


@settings(max_examples=60)
@given(
    st.floats(-2.5, 2.5), st.floats(-2.5, 2.5), st.floats(-0.5, 13.0),
    st.floats(-np.pi, np.pi), st.floats(-1.5, 1.5), st.floats(-np.pi, np.pi),
)  # fmt: skip
def test_any_pose_about_a_pylon_gives_a_picture(x, y, z, roll, pitch, yaw):
    draw(GATE, body_pose(roll, pitch, yaw, [20.0 + x, 5.0 + y, z]))


def test_same_pose_same_picture():
    track = load_track("student-airrace")
    renderer, other = (PlanarRenderer(track, CAMERA_INFO) for _ in range(2))
    pose = body_pose(0.3, 0.1, 0.2, [10.0, 1.0, 5.0])
    pictures = [new_picture() for _ in range(3)]
    renderer.render(pose, pictures[0])
    renderer.render(body_pose(1.0, 0.0, 2.0, [-20.0, 1.0, 9.0]), pictures[1])
    renderer.render(pose, pictures[1])
    other.render(pose, pictures[2])
    assert np.array_equal(pictures[0], pictures[1])
    assert np.array_equal(pictures[0], pictures[2])


def test_markers_of_the_first_gates_are_seen_from_the_start():
    picture = draw(load_track("student-airrace"), body_pose(0, 0, 0, [0.0, 0.0, 5.0]))
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_ARUCO_ORIGINAL)
    _, ids, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(
        cv2.cvtColor(picture, cv2.COLOR_RGBA2GRAY)
    )
    assert {0, 2} <= set(np.ravel(ids).tolist())


def test_grey_levels_are_those_of_the_colours():
    renderer = PlanarRenderer(load_track("student-airrace"), CAMERA_INFO)
    for heading in (0.0, 1.0, 2.5):
        X_WC = body_pose(heading, 0.1, 0.05, [1.0, -2.0, 4.0])
        colored, levels = new_picture(), np.zeros(new_picture().shape[:2], np.uint8)
        renderer.render(X_WC, colored)
        renderer.render(X_WC, levels)
        difference = cv2.cvtColor(colored, cv2.COLOR_RGBA2GRAY).astype(int) - levels
        assert np.abs(difference).max() <= 4 and abs(difference.mean()) < 0.5


@settings(max_examples=300)
@given(
    st.tuples(*2 * [st.floats(-np.pi, np.pi)], st.floats(-1.4, 1.4)),
    st.tuples(*2 * [st.floats(-40, 40)], st.floats(-2, 20)),
)
def test_what_is_left_out_as_out_of_sight_is(turn, p_WC):
    """No point of a pylon, or where a board may be, is in the picture beyond the pylon's box."""
    roll, yaw, pitch = turn
    P = CAMERA_INFO.K @ body_pose(roll, pitch, yaw, [0, 0, 0]).rotation().matrix().T
    picture = Box(0, 0, CAMERA_INFO.width, CAMERA_INFO.height)
    angles, heights = np.meshgrid(np.linspace(0, 6.2, 20), np.linspace(5.5, 7.0, 6))
    around = [1.25 * np.cos(angles), 1.25 * np.sin(angles), heights]  # corners of boards
    for foot in ([5.0, 2.0, 0.0], [-9.0, 30.0, 0.0], [0.3, 0.2, 0.0]):
        p_CF_W = np.array(foot) - p_WC
        box = pylon_box(p_CF_W, View(P, picture, np.array([picture])))
        x, y, z = P @ (p_CF_W[:, None] + np.reshape(around, (3, -1)))
        seen = z > NEAR
        u, v = x[seen] / z[seen], y[seen] / z[seen]
        shown = (u > 0) & (u < picture.x1 - 1) & (v > 0) & (v < picture.y1 - 1)
        assert np.all((u >= box.x0) & (u < box.x1) & (v >= box.y0) & (v < box.y1) | ~shown)
