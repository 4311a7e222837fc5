"""Quaternions: the same rotations as Drake's, and how they turn."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.eigen_geometry import AngleAxis, Quaternion
from pydrake.math import RotationMatrix

from airrace.common.jit import compiled
from airrace.math.quaternion import integrate, rotation_matrix

numbers = st.floats(-1.0, 1.0)
vectors = st.tuples(numbers, numbers, numbers).map(np.array)
quaternions = st.tuples(*[numbers] * 4).map(np.array).filter(lambda q: np.linalg.norm(q) > 0.1)


@compiled
def compiled_rotation(q, w, dt):
    return rotation_matrix(integrate(q, w, dt))


@given(quaternions, st.floats(0.1, 10.0))
def test_rotation_matrix_is_drakes(q, length):
    R = rotation_matrix(length * q)
    expected = RotationMatrix(Quaternion(q / np.linalg.norm(q))).matrix()
    np.testing.assert_allclose(R, expected, atol=1e-12)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)


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
