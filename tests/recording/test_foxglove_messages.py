import cv2
import numpy as np
import pytest
from foxglove import messages as fg
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RotationMatrix

from airrace.recording import foxglove_messages
from airrace.systems.types import Detection, Detections
from airrace.trajopt.reference import as_reference
from airrace.vehicle.camera_info import make_camera_info
from airrace.vehicle.state import as_state
from tests.recording.decoding import decoded, vector

numbers = st.floats(-50, 50)
INFO = make_camera_info(width=64, height=48, fov_y=1.0, X_BC=RigidTransform())


@given(time=st.floats(0, 1e4))
def test_a_stamp_is_the_time(time):
    stamp = decoded(fg.Log(timestamp=foxglove_messages.stamp(time))).timestamp
    assert stamp.seconds + stamp.nanos / 1e9 == pytest.approx(time, abs=1e-9)
    assert 0 <= stamp.nanos < 1_000_000_000


@given(
    q=st.tuples(numbers, numbers, numbers, numbers).filter(lambda q: np.linalg.norm(q) > 1e-2),
    p=st.tuples(numbers, numbers, numbers),
    v=st.tuples(numbers, numbers, numbers),
    w=st.tuples(numbers, numbers, numbers),
)
def test_velocities_are_in_the_body_frame(q, p, v, w):
    q = np.array(q) / np.linalg.norm(q)
    R_WB = RotationMatrix(Quaternion(q))
    message = decoded(foxglove_messages.odometry(as_state(np.array([1.5, *q, *p, *w, *v]))))
    assert (message.frame_id, message.body_frame_id) == ("world", "body")
    np.testing.assert_allclose(vector(message.pose.position), p, atol=1e-5)
    np.testing.assert_allclose(vector(message.linear_velocity), R_WB.inverse() @ v, atol=2e-5)
    np.testing.assert_allclose(vector(message.angular_velocity), R_WB.inverse() @ w, atol=2e-5)


def test_a_reference_is_level_and_turned_by_its_yaw():
    reference = np.arange(1.0, 19.0)
    reference[15:17] = np.pi / 2, 0.3
    message = decoded(foxglove_messages.reference_odometry(0.0, as_reference(reference)))
    o = message.pose.orientation
    np.testing.assert_allclose([o.w, o.x, o.y, o.z], [0.5**0.5, 0, 0, 0.5**0.5], atol=1e-6)
    np.testing.assert_allclose(vector(message.linear_velocity), [5, -4, 6], atol=1e-5)
    np.testing.assert_allclose(vector(message.angular_velocity), [0, 0, 0.3], atol=1e-6)


def test_rotors_have_speeds_and_thrusts():
    joints = decoded(foxglove_messages.rotors(2.0, [10.0, 20.0], np.array([0.01, 0.02]))).joints
    assert [joint.name for joint in joints] == ["rotor_1", "rotor_2"]
    assert [joint.velocity for joint in joints] == [10.0, 20.0]
    assert [joint.effort for joint in joints] == pytest.approx([1.0, 8.0])


def test_transforms_lead_from_the_world_to_the_camera():
    X_BC = RigidTransform(RotationMatrix.MakeXRotation(0.3), [0.1, 0.2, 0.3])
    message = decoded(
        foxglove_messages.transforms(
            as_state(np.array([1.0, 1, 0, 0, 0, 4, 5, 6, *np.zeros(6)])), X_BC
        )
    )
    frames = [(t.parent_frame_id, t.child_frame_id) for t in message.transforms]
    assert frames == [("world", "body"), ("body", "camera")]
    np.testing.assert_allclose(vector(message.transforms[0].translation), [4, 5, 6])
    q = message.transforms[1].rotation
    assert RotationMatrix(Quaternion(q.w, q.x, q.y, q.z)).IsNearlyEqualTo(X_BC.rotation(), 1e-6)


@given(x=numbers, y=numbers, z=st.floats(1, 30))
def test_a_smaller_picture_has_a_calibration_that_fits(x, y, z):
    """What is at the edge between two pixels stays at the edge between two of half as many."""
    info = make_camera_info(width=64, height=48, fov_y=1.0, X_BC=RigidTransform())
    message = decoded(foxglove_messages.calibration(0.0, info, 0.5))
    assert (message.width, message.height) == (32, 24)
    full, half = ((K.reshape(3, 3) @ [x, y, z])[:2] / z for K in (info.K, np.array(message.K)))
    np.testing.assert_allclose(half + 0.5, (full + 0.5) / 2, atol=1e-9)
    assert len(message.P) == 12 and len(message.D) == 5


def test_annotations_outline_markers_where_the_picture_has_them():
    corners = np.array([[9.5, 19.5], [29.5, 19.5], [29.5, 39.5], [9.5, 39.5]])
    marker = Detection(id=8, corners=corners, X_CM=RigidTransform(), reprojection_error=0.1)
    message = decoded(
        foxglove_messages.annotations(Detections(time=3.0, markers=(marker,)), INFO, 0.5)
    )
    (outline,), (text,) = message.points, message.texts
    assert outline.type == fg.PointsAnnotationType.LineLoop.value
    points = [[p.x, p.y] for p in outline.points]
    np.testing.assert_allclose(points, (corners + 0.5) / 2 - 0.5)
    assert text.text == "8" and outline.timestamp.seconds == 3


def test_pixels_of_a_lens_that_distorts_are_those_of_its_own_picture():
    D = (-0.25, 0.08, 0.001, -0.001, 0.0)
    info = make_camera_info(width=640, height=480, fov_y=1.0, X_BC=RigidTransform(), D=D)
    pixels = np.array([[320.0, 240.0], [600.0, 30.0], [5.0, 470.0]])
    raw = foxglove_messages.raw_pixels(pixels, info)
    assert np.abs(raw - pixels).max() > 5.0
    again = cv2.undistortPoints(raw[:, None], info.K, info.D, R=info.R, P=info.P)[:, 0]
    np.testing.assert_allclose(again, pixels, atol=0.05)  # of its iterations
    np.testing.assert_array_equal(foxglove_messages.raw_pixels(pixels, INFO), pixels)
    nothing_seen = decoded(foxglove_messages.annotations(Detections(time=3.0), info))
    assert len(nothing_seen.points) == len(nothing_seen.texts) == 0


def test_a_jpeg_is_as_large_as_the_calibration_says():
    picture = np.tile(np.arange(128, dtype=np.uint8), (96, 1))
    for scale in (1.0, 0.5):
        jpeg = np.frombuffer(foxglove_messages.jpeg(picture, scale, 90), np.uint8)
        again = cv2.imdecode(jpeg, cv2.IMREAD_UNCHANGED)
        assert again.shape == (96 * scale, 128 * scale)
        assert abs(again[0, -1] - 127.0) < 5
