import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.math.small_matrices import (
    affine,
    apply,
    cholesky,
    inverse,
    mirrored,
    product,
    propagated,
    reduced,
    skew,
    solve_cholesky,
    solve_lower,
    solve_upper,
)


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


@given(st.integers(1, 8), st.integers(1, 8), st.integers(0, 1000))
def test_products_are_those_of_numpy(n, k, seed):
    rng = np.random.default_rng(seed)
    A, B = rng.standard_normal((n, k)), rng.standard_normal((k, n))
    A[rng.random((n, k)) < 0.3] = 0.0
    x, b = rng.standard_normal(k), rng.standard_normal(n)
    P = np.eye(k) + B @ B.T
    np.testing.assert_allclose(product(A, B), A @ B, atol=1e-12)
    np.testing.assert_allclose(apply(A, x), A @ x, atol=1e-12)
    np.testing.assert_allclose(affine(A, x, b), A @ x + b, atol=1e-12)
    np.testing.assert_allclose(propagated(A, P), A @ P @ A.T, atol=1e-12)
    np.testing.assert_allclose(reduced(P, B), P - B @ B.T, atol=1e-12)
    np.testing.assert_array_equal(reduced(P, B), reduced(P, B).T)


def test_a_matrix_is_mirrored_at_its_diagonal():
    A = np.arange(9.0).reshape(3, 3)
    np.testing.assert_array_equal(mirrored(A), np.tril(A) + np.tril(A, -1).T)


def test_every_column_is_solved_for():
    rng, A = make(4, 0)
    L, B = cholesky(A), rng.standard_normal((4, 3))
    np.testing.assert_allclose(L @ solve_lower(L, B), B, atol=1e-9)


def test_the_matrix_of_a_cross_product():
    v, w = np.array([1.0, -2.0, 3.0]), np.array([0.5, 4.0, -1.0])
    np.testing.assert_array_equal(skew(v) @ w, np.cross(v, w))
