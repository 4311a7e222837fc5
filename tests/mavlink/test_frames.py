import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RollPitchYaw

from airrace.math.quaternion import rotation_matrix
from airrace.mavlink.frames import euler_angles, flipped, flipped_quaternion, ned_state
from airrace.vehicle.state import State

angles = st.floats(-3.0, 3.0)
vectors = st.lists(st.floats(-9.0, 9.0), min_size=3, max_size=3).map(np.array)
FLIP = np.diag([1.0, -1.0, -1.0])


def quaternion(roll, pitch, yaw):
    return RollPitchYaw(roll, pitch, yaw).ToQuaternion().wxyz()


@given(vectors)
def test_frames_lead_there_and_back(v):
    np.testing.assert_array_equal(flipped(flipped(v)), v)
    np.testing.assert_array_equal(flipped(v), FLIP @ v)


@given(angles, angles, angles)
def test_a_rotation_is_the_same_between_the_other_frames(roll, pitch, yaw):
    q = quaternion(roll, pitch, yaw)
    R = rotation_matrix(flipped_quaternion(q))
    np.testing.assert_allclose(R, FLIP @ rotation_matrix(q) @ FLIP, atol=1e-12)
    np.testing.assert_array_equal(flipped_quaternion(flipped_quaternion(q)), q)


@given(angles, st.floats(-1.5, 1.5), angles, st.floats(0.1, 3.0))
def test_euler_angles_are_those_of_the_rotation(roll, pitch, yaw, length):
    np.testing.assert_allclose(
        euler_angles(length * quaternion(roll, pitch, yaw)), [roll, pitch, yaw], atol=1e-6
    )


def test_a_nose_up_to_the_left_is_pitch_up_and_a_yaw_to_the_left():
    """FRD has a positive pitch for the nose up and a negative yaw to the left."""
    R_WB = RollPitchYaw(0.0, -0.2, 0.3)  # about y to the left: up is negative
    state = State(
        0.0,
        R_WB.ToQuaternion().wxyz(),
        np.array([1.0, 2.0, 3.0]),
        np.array([0.1, 0.2, 0.3]),
        np.array([4.0, 5.0, 6.0]),
    )
    ned = ned_state(state, R_WB.ToRotationMatrix().matrix(), np.array([0.0, 1.0, 1.0]))
    assert euler_angles(ned.quaternion) == pytest.approx((0.0, 0.2, -0.3))
    np.testing.assert_allclose(ned.position, [1.0, -1.0, -2.0])
    np.testing.assert_allclose(ned.velocity, [4.0, -5.0, -6.0])
    w_B = R_WB.ToRotationMatrix().matrix().T @ [0.1, 0.2, 0.3]
    np.testing.assert_allclose(ned.rates, FLIP @ w_B)
