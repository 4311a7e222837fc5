import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.systems.perception.marker_pose import locate, locate_alone, locate_gate
from tests.systems.perception.marker_pictures import INFO, gate, pose, project

SIGMA = 0.05  # px
COVARIANCE = SIGMA**2 * np.eye(8)
angles = st.floats(-0.9, 0.9)


def locate_pair(ids, corners):
    return locate_gate(ids, corners, np.array([COVARIANCE, COVARIANCE]), INFO)


def assert_close(X_CM, true, atol):
    np.testing.assert_allclose(X_CM.translation(), true.translation(), atol=atol)
    assert X_CM.rotation().IsValid()


@pytest.mark.slow
@given(angles, angles, st.floats(-4, 4), st.floats(-2, 2), st.floats(6, 35))
def test_locate_inverts_the_projection(pitch, yaw, x, y, z):
    """From exact corners, the position is exact."""
    X_CM = pose(x, y, z, pitch, yaw)
    marker = locate(5, project(X_CM), COVARIANCE, INFO)
    assert_close(marker.X_CM, X_CM, 1e-5 * z)
    assert marker.face == "back" and not marker.joint and 0 <= marker.ambiguity <= 1


@pytest.mark.parametrize("yaw", [0.0, 0.3, -0.44])
@pytest.mark.parametrize("x", [0.0, 1.0, -3.3])
def test_locate_in_views_of_perfect_symmetry(yaw, x):
    """OpenCV's closed form fails in some of them."""
    for z in np.linspace(6.0, 35.0, 100):
        X_CM = pose(x, 0.0, z, yaw=yaw)
        assert_close(locate(5, project(X_CM), COVARIANCE, INFO).X_CM, X_CM, 1e-5 * z)


@pytest.mark.slow
@given(angles, st.floats(-0.2, 0.2), st.floats(-2, 2), st.floats(12, 35), st.booleans())
def test_both_markers_of_a_gate(yaw, pitch, x, z, back):
    truth = gate(pose(x, 0.0, z, pitch, yaw), back=back)
    ids = (9, 11) if back else (8, 10)
    found = locate_pair(ids, [project(X_CM) for X_CM in truth])
    for id, X_CM in zip(ids, truth):
        assert_close(found[id].X_CM, X_CM, 1e-5 * z)
        assert found[id].joint and found[id].face == ("back" if back else "front")
        assert found[id].reprojection_error < 1e-3


def test_a_gate_of_another_width_is_not_solved_jointly():
    for spacing in (6.0, 9.5, 10.5, 14.0):
        corners = [project(X_CM) for X_CM in gate(pose(0, 0, 20, yaw=0.4), spacing)]
        assert locate_pair((0, 2), corners) == {}


@pytest.mark.parametrize("joint", [False, True])
@pytest.mark.parametrize("yaw", [0.3, -0.7])
def test_covariance_is_that_of_the_errors(joint, yaw):
    rng = np.random.default_rng(2)
    truth = gate(pose(1.0, 0.5, 15.0, yaw=yaw))
    corners = np.array([project(X_CM) for X_CM in truth])
    errors, joints = [], []
    for _ in range(300):
        noisy = corners + rng.normal(0, SIGMA, corners.shape)
        if joint:
            marker = locate_pair((0, 2), noisy)[2]
        else:
            marker = locate(2, noisy[1], COVARIANCE, INFO)
        turn = (marker.X_CM.rotation() @ truth[1].rotation().inverse()).ToAngleAxis()
        errors.append(
            np.concatenate(
                [turn.angle() * turn.axis(), marker.X_CM.translation() - truth[1].translation()]
            )
        )
        joints.append(marker.covariance)
    predicted = np.mean(joints, axis=0)
    ratios = np.std(errors, axis=0) / np.sqrt(np.diag(predicted))
    np.testing.assert_allclose(ratios, 1.0, atol=0.2)
    misfit = np.mean([e @ np.linalg.solve(predicted, e) for e in errors]) / 6
    assert 0.7 < misfit < 1.4


def test_the_joint_pose_is_the_better_one():
    corners = [project(X_CM) for X_CM in gate(pose(0.0, 0.0, 25.0))]
    alone = locate(0, corners[0], COVARIANCE, INFO)
    jointly = locate_pair((0, 2), corners)[0]
    assert np.all(np.diag(jointly.covariance) < np.diag(alone.covariance))


@given(angles, angles, st.floats(-4, 4), st.floats(-2, 2), st.floats(6, 35), st.integers(0, 99))
def test_opencvs_pose_of_one_marker_inverts_the_projection(pitch, yaw, x, y, z, seed):
    X_CM = pose(x, y, z, pitch, yaw)
    noise = np.random.default_rng(seed).normal(0.0, 0.01, (4, 2))
    marker = locate_alone(5, project(X_CM) + noise, INFO)
    assert_close(marker.X_CM, X_CM, 5e-3 * z)
    assert not marker.joint and 0 <= marker.ambiguity <= 1
    assert np.all(np.linalg.eigvalsh(marker.covariance) > 0)


def test_opencvs_pose_has_the_reprojection_error_of_its_docstring():
    corners = project(pose(1.0, 0.5, 15.0, yaw=0.4)) + [[0.3, 0], [0, -0.2], [0.1, 0.1], [-0.2, 0]]
    marker = locate_alone(5, corners, INFO)
    off = np.linalg.norm(project(marker.X_CM) - corners, axis=1)
    assert marker.reprojection_error == pytest.approx(np.sqrt(np.mean(off**2)), rel=1e-6)


@pytest.mark.parametrize("yaw", [0.0, 0.3, -0.44])
@pytest.mark.parametrize("x", [0.0, 1.0, -3.3])
def test_opencvs_pose_in_views_of_perfect_symmetry(yaw, x):
    """A pose near the true one, or none: OpenCV loses some of their rotations."""
    for z in np.linspace(6.0, 35.0, 30):
        X_CM = pose(x, 0.0, z, yaw=yaw)
        marker = locate_alone(5, project(X_CM), INFO)
        if marker is not None:
            assert_close(marker.X_CM, X_CM, 0.02 * z)


@pytest.mark.parametrize("corners", [np.full((4, 2), np.nan), np.zeros((4, 2))])
def test_what_is_no_square_has_no_pose(corners):
    assert locate(5, corners, COVARIANCE, INFO) is None
    assert locate_alone(5, corners, INFO) is None
    assert locate_pair((0, 2), [corners, corners]) == {}
