"""Tuples of three numbers: the same vectors and rotations as numpy's and Drake's."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.eigen_geometry import AngleAxis, Quaternion
from pydrake.math import RotationMatrix

from airrace.math import triples

numbers = st.floats(-10.0, 10.0)
vectors = st.tuples(numbers, numbers, numbers)
quaternions = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1)


def equal(found, expected):
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


def drakes(q):
    return RotationMatrix(Quaternion(np.array(q) / np.linalg.norm(q)))


@given(vectors, vectors, numbers)
def test_vectors_are_numpys(a, b, factor):
    equal(triples.dot(a, b), np.dot(a, b))
    equal(triples.cross(a, b), np.cross(a, b))
    equal(triples.times(a, b), np.multiply(a, b))
    equal(triples.difference(a, b), np.subtract(a, b))
    equal(triples.scaled(factor, a), factor * np.array(a))
    equal(triples.added(a, factor, b), np.array(a) + factor * np.array(b))


@given(quaternions, vectors)
def test_rotations_are_drakes(q, v):
    rows, R = triples.rotation_rows(q), drakes(q).matrix()
    equal(rows, R)
    equal(triples.rotate(rows, v), R @ v)
    equal(triples.rotate_back(rows, v), R.T @ v)


@given(quaternions, quaternions)
def test_a_product_turns_by_one_after_the_other(a, b):
    equal(drakes(triples.quaternion_product(a, b)).matrix(), (drakes(a) @ drakes(b)).matrix())
    equal(np.linalg.norm(triples.normalized(a)), 1.0)


@given(quaternions, vectors)
def test_a_turn_is_about_axes_of_the_body(q, vector):
    angle = np.linalg.norm(vector)
    turn = RotationMatrix(AngleAxis(angle, np.array(vector) / angle) if angle else AngleAxis())
    equal(triples.rotation_rows(triples.exp_quaternion(vector)), turn.matrix())
    equal(triples.rotation_rows(triples.turned(q, vector)), (drakes(q) @ turn).matrix())


@given(quaternions, quaternions)
def test_the_turn_between_two_leads_from_one_to_the_other(q_1, q_2):
    turn = triples.rotation_between(q_1, q_2)
    assert np.linalg.norm(turn) <= np.pi + 1e-9
    there = triples.rotation_rows(triples.turned(q_1, turn))
    np.testing.assert_allclose(there, drakes(q_2).matrix(), atol=1e-9)


@given(quaternions, vectors)
def test_angular_velocity_is_in_the_world(q, w_W):
    dt = 1e-4
    after = drakes(triples.integrate(triples.normalized(q), w_W, dt))
    turn = AngleAxis((after @ drakes(q).inverse()).matrix())
    np.testing.assert_allclose(turn.angle() * turn.axis(), dt * np.array(w_W), atol=1e-8)
