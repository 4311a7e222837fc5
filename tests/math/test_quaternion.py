"""Quaternions: the same rotations as Drake's, and how they turn."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.eigen_geometry import AngleAxis, Quaternion
from pydrake.math import RotationMatrix

from airrace.common.jit import compiled
from airrace.math.quaternion import (
    heading,
    integrate,
    reference_yaw,
    rotation_between,
    rotation_matrix,
)
from airrace.trajopt.flatness import attitude_from_force, heading_vectors

numbers = st.floats(-1.0, 1.0)
vectors = st.tuples(numbers, numbers, numbers).map(np.array)
quaternions = st.tuples(*[numbers] * 4).map(np.array).filter(lambda q: np.linalg.norm(q) > 0.1)


@compiled
def compiled_rotation(q, w, dt):
    return rotation_matrix(integrate(q, w, dt))


@given(st.floats(-3.1, 3.1), vectors)
def test_the_yaw_of_an_attitude_is_the_one_that_it_was_made_of(yaw, a):
    """By what makes attitudes of references; that of x seen from above is another one."""
    zero = np.zeros(3)
    force = 9.0 * a + np.array([0.0, 0.0, 12.0])
    axes, *_ = attitude_from_force(
        force, zero, zero, heading_vectors(np.cos(yaw), np.sin(yaw), 0, 0)
    )
    q = RotationMatrix(np.column_stack(axes)).ToQuaternion().wxyz()
    assert np.cos(reference_yaw(3.0 * q) - yaw) == pytest.approx(1.0, abs=1e-12)


@given(quaternions, st.floats(0.1, 10.0))
def test_the_heading_is_that_of_the_bodys_x_axis(q, length):
    x, y, _ = RotationMatrix(Quaternion(q / np.linalg.norm(q))).matrix()[:, 0]
    if np.hypot(x, y) > 1e-3:
        assert np.cos(heading(length * q) - np.arctan2(y, x)) == pytest.approx(1.0)


@given(quaternions, st.floats(0.1, 10.0))
def test_rotation_matrix_is_drakes(q, length):
    R = rotation_matrix(length * q)
    expected = RotationMatrix(Quaternion(q / np.linalg.norm(q))).matrix()
    np.testing.assert_allclose(R, expected, atol=1e-12)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)


@given(quaternions, quaternions, st.floats(-10.0, -0.1))
def test_the_rotation_between_two_leads_from_one_to_the_other(q_1, q_2, factor):
    r = rotation_between(factor * q_1, q_2)
    angle = np.linalg.norm(r)
    assert angle <= np.pi + 1e-9
    turn = RotationMatrix(AngleAxis(angle, r / angle)) if angle > 1e-6 else RotationMatrix()
    there = rotation_matrix(q_1) @ turn.matrix()
    np.testing.assert_allclose(there, rotation_matrix(q_2), atol=1e-6 if angle <= 1e-6 else 1e-9)
    np.testing.assert_allclose(rotation_between(q_2, q_1), -r, atol=1e-9 if angle < 3.14 else 7)


@pytest.mark.parametrize("angle", [0.0, 1e-20, 1e-13, 1e-9, 1e-5, 1.0, 3.14159])
def test_small_and_large_rotations_keep_their_digits(angle):
    q = np.array([np.cos(angle / 2), 0.0, np.sin(angle / 2), 0.0])
    r = rotation_between(np.array([1.0, 0, 0, 0]), 3.0 * q)
    np.testing.assert_allclose(r, [0, angle, 0], rtol=1e-12, atol=0)


@given(quaternions, vectors, st.floats(-0.01, 0.01))
def test_the_error_of_integration_is_a_twelfth_of_the_cube_of_the_angle(q, w, dt):
    q = q / np.linalg.norm(q)
    after = integrate(q, 10.0 * w, dt)
    assert np.linalg.norm(after) == pytest.approx(1.0, abs=1e-12)
    rate = 10.0 * np.linalg.norm(w)
    turn = AngleAxis(rate * dt, 10.0 * w / rate) if rate > 1e-3 else AngleAxis()
    exact = RotationMatrix(turn) @ RotationMatrix(Quaternion(q))
    error = (exact.inverse() @ RotationMatrix(Quaternion(after))).ToAngleAxis().angle()
    assert error <= abs(rate * dt) ** 3 / 12 + (1e-7 if rate > 1e-3 else 1e-4)
    np.testing.assert_allclose(compiled_rotation(q, 10.0 * w, dt), exact.matrix(), atol=2e-4)
