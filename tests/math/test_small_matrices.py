import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.math.small_matrices import cholesky, inverse, solve_cholesky, solve_lower, solve_upper


def make(n, seed):
    """Returns a generator of random numbers and a symmetric positive definite matrix."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n, n + 2))
    return rng, A @ A.T


@given(st.integers(1, 8), st.integers(0, 1000))
def test_as_numpy_does_it(n, seed):
    rng, A = make(n, seed)
    b = rng.standard_normal(n)
    L = cholesky(A)
    np.testing.assert_allclose(L, np.linalg.cholesky(A), atol=1e-9 * np.abs(A).max())
    np.testing.assert_allclose(A @ solve_cholesky(L, b), b, atol=1e-6)
    np.testing.assert_allclose(L @ solve_lower(L, b), b, atol=1e-9)
    np.testing.assert_allclose(L.T @ solve_upper(L, b), b, atol=1e-6)
    np.testing.assert_allclose(inverse(A) @ A, np.eye(n), atol=1e-6)
    np.testing.assert_array_equal(inverse(A), inverse(A).T)


@pytest.mark.parametrize(
    "matrix",
    [
        -np.eye(3),
        np.diag([1.0, -1e-3, 1.0]),
        np.ones((3, 3)) - 1.5 * np.eye(3),
        np.zeros((3, 3)),
        np.full((3, 3), np.nan),
    ],
)
def test_what_is_not_positive_definite_shows(matrix):
    """In the last element, where is_below() and others look for it."""
    assert np.isnan(cholesky(matrix)[-1, -1])
