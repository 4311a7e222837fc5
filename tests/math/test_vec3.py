"""Products of vectors, one pair and many at once."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from airrace.common.jit import compiled
from airrace.math.vec3 import cross, dot, rotate

numbers = st.floats(-1.0, 1.0)
vectors = st.tuples(numbers, numbers, numbers).map(np.array)


@compiled
def compiled_products(a, b):
    return dot(a, b), cross(a, b)


@given(vectors, vectors)
def test_products_are_numpys(a, b):
    for product, vector in (compiled_products(a, b), (dot(a, b), cross(a, b))):
        np.testing.assert_allclose(product, a @ b, atol=1e-15)
        np.testing.assert_allclose(vector, np.cross(a, b), atol=1e-15)


def test_a_matrix_times_a_vector():
    rng = np.random.default_rng(0)
    R, v = rng.normal(size=(3, 3)), rng.normal(size=3)
    np.testing.assert_allclose(rotate(R, v), R @ v)
    np.testing.assert_allclose(rotate(R.T, v), R.T @ v)


def test_many_at_once():
    a, b = np.random.default_rng(0).normal(size=(2, 3, 5))
    np.testing.assert_allclose(dot(a, b), np.sum(a * b, axis=0))
    np.testing.assert_allclose(cross(a, b), np.cross(a, b, axis=0))
    R = np.random.default_rng(1).normal(size=(3, 3))
    np.testing.assert_allclose(rotate(R, a), R @ a)
