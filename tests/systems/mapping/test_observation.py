import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from airrace.systems.mapping.observation import make_observation, refusal
from airrace.systems.types import Detection
from airrace.vehicle.camera_info import make_camera_info

INFO = make_camera_info(width=1280, height=720, fov_y=1.0, X_BC=RigidTransform())
FACING = RotationMatrix(np.diag([1.0, -1.0, -1.0]))  # a marker that faces the camera


def detection(id=0, R=FACING, p=(1.0, 0.5, 10.0), corner=0.0, **kwargs):
    return Detection(id, np.full((4, 2), corner), RigidTransform(R, p), 0.1, **kwargs)


@pytest.mark.parametrize(
    "marker, reason",
    [
        (detection(), None),
        (detection(id=39), None),
        (detection(covariance=np.zeros((6, 6))), None),
        (detection(id=40), "foreign ID"),
        (detection(id=-1), "foreign ID"),
        (detection(p=[np.nan, 0, 5]), "corners, pose or covariance make no sense"),
        (detection(p=[0, 0, np.inf]), "corners, pose or covariance make no sense"),
        (
            detection(covariance=np.full((6, 6), np.nan)),
            "corners, pose or covariance make no sense",
        ),
        (detection(covariance=-np.eye(6)), "corners, pose or covariance make no sense"),
        (detection(covariance=1e200 * np.eye(6)), "corners, pose or covariance make no sense"),
        (detection(corner=np.nan), "corners, pose or covariance make no sense"),
        (detection(p=[0, 0, 31.0]), "beyond the range"),
        (detection(p=[0, 0, 1e300]), "beyond the range"),
        (detection(R=RotationMatrix()), "seen from behind"),
        (detection(p=[0, 0, -5.0]), "seen from behind"),
        (detection(p=[0, 0, 0]), "seen from behind"),
    ],
)
def test_refusal(marker, reason):
    assert refusal(marker, 39, 30.0) == reason


rotations = st.tuples(*[st.floats(-3, 3)] * 3).map(lambda rpy: RollPitchYaw(rpy).ToRotationMatrix())
vectors = st.tuples(*[st.floats(-20, 20)] * 3).map(np.array)


@given(rotations, vectors, st.integers(0, 100))
def test_an_observation_is_the_detection_in_the_world(R_WC, p_WC, seed):
    A = np.random.default_rng(seed).standard_normal((6, 6)) / 100
    marker = detection(covariance=A @ A.T)
    X_WC = RigidTransform(R_WC, p_WC)
    observation = make_observation(marker, X_WC, INFO, 1.5)
    np.testing.assert_allclose(observation.p_WM, X_WC @ np.array([1.0, 0.5, 10.0]), atol=1e-9)
    np.testing.assert_allclose(observation.normal, R_WC @ np.array([0, 0, -1.0]), atol=1e-9)
    np.testing.assert_array_equal(observation.p_WC, p_WC)
    assert (observation.id, observation.time) == (0, 1.5)
    # No direction is surer than the detector says, or than the drone's pose.
    R = R_WC.matrix()
    extra = observation.covariance - R @ (A @ A.T)[3:, 3:] @ R.T
    assert np.linalg.eigvalsh(extra)[0] >= 0.005**2 - 1e-12
    assert observation.heading_variance >= R[2] @ (A @ A.T)[:3, :3] @ R[2]


@pytest.mark.parametrize("covariance", [None, 1e-4 * np.eye(6)])
def test_far_is_uncertain_and_most_so_along_the_ray(covariance):
    near, far = (
        make_observation(detection(p=[0, 0, z], covariance=covariance), RigidTransform(), INFO, 0.0)
        for z in (5.0, 25.0)
    )
    assert np.trace(far.covariance) > 10 * np.trace(near.covariance)
    assert far.covariance[2, 2] > 10 * far.covariance[0, 0]


def test_two_markers_together_tell_the_distance_better():
    alone = detection(p=[0, 0, 25.0], covariance=1e-4 * np.eye(6))
    joint = dc.replace(alone, joint=True)
    variances = [
        make_observation(marker, RigidTransform(), INFO, 0.0).covariance[2, 2]
        for marker in (alone, joint)
    ]
    assert variances[1] < variances[0] / 10


def test_an_ambiguous_normal_says_little():
    clear, ambiguous = (
        make_observation(detection(ambiguity=a), RigidTransform(), INFO, 0.0) for a in (0.0, 0.9)
    )
    assert ambiguous.heading_variance > 20 * clear.heading_variance
