import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from airrace.systems.perception import detection_checks as checks
from airrace.systems.types import Detection
from tests.systems.perception.marker_pictures import INFO, gate, picture, pose, project

SQUARE = np.array([[100.0, 100.0], [140.0, 100.0], [140.0, 140.0], [100.0, 140.0]])


def test_quads():
    assert checks.check_quad(SQUARE) is None
    assert checks.check_quad(SQUARE[::-1]) == checks.FROM_BEHIND
    assert checks.check_quad(0.1 * SQUARE) == checks.TINY
    dented = SQUARE.copy()
    dented[2] = [112.0, 112.0]
    assert checks.check_quad(dented) == checks.NON_CONVEX


def test_refits_that_run_away():
    assert checks.check_corners(SQUARE + 1.0, SQUARE) is None
    assert checks.check_corners(SQUARE + [[0, 0], [0, 0], [0, 30], [0, 0]], SQUARE)
    assert checks.check_corners(np.full((4, 2), np.nan), SQUARE) == checks.NO_EDGES


def test_images():
    good = np.zeros((720, 1280), np.uint8)
    assert checks.check_view(good, 0.0, INFO) is None
    assert checks.check_view(good, np.nan, INFO) == checks.NO_TIME
    color = np.dstack(3 * [good])
    for bad in (None, good[:0], good[:300], good[..., :3], color, good.astype(float)):
        assert checks.check_view(bad, 0.0, INFO) == checks.WRONG_IMAGE


@pytest.mark.slow
@pytest.mark.parametrize("distance", [10.0, 30.0])
def test_another_id_is_noticed(distance):
    X_CM = pose(0.5, -0.3, distance, yaw=0.5)
    grey = picture({4: X_CM}, blur=0.6, noise=3.0)
    assert checks.check_id(grey, project(X_CM), 4) is None
    for id in set(range(80)) - {4}:
        assert checks.check_id(grey, project(X_CM), id) == checks.MISREAD


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize("roll", [0.0, 2.0, -3.0])
def test_markers_on_the_wrong_side_of_each_other(back, roll):
    left, right = (project(X_CM) for X_CM in gate(pose(0, 0, 20, yaw=0.6, roll=roll), back=back))
    assert not checks.swapped_pair(int(back), left, right)
    assert checks.swapped_pair(int(back), right, left)
    assert checks.swapped_pair(int(not back), left, right)


def detection(X_CM):
    return Detection(4, SQUARE, X_CM, 0.0, covariance=1e-6 * np.eye(6))


def test_jumps():
    before = detection(pose(0, 0, 20))
    # Turning the camera moves a marker far, but does not bring it nearer.
    turn = RigidTransform(RollPitchYaw(0.1, 0.3, 0.1), [0, 0, 0])
    assert not checks.jumps(detection(turn @ before.X_CM), before, 1 / 30)
    assert not checks.jumps(detection(pose(0, 0, 20.7)), before, 1 / 30)
    assert checks.jumps(detection(pose(0, 0, 22)), before, 1 / 30)
    assert checks.jumps(detection(pose(0, 0, 20, yaw=0.8)), before, 1 / 30)
    assert not checks.jumps(detection(pose(0, 0, 22)), before, 1.0)  # too long ago
