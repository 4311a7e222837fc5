"""Errors of attitude: what they are near zero, how they grow, and that they never vanish."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RollPitchYaw, RotationMatrix

from airrace.systems.control.attitude_error import lead_moment, lee_error, reduced_error, tilt_error

Z = np.array([0.0, 0.0, 1.0])
REST = np.zeros(3)
numbers = st.floats(-1.0, 1.0)
vectors = st.tuples(numbers, numbers, numbers).map(np.array)
units = vectors.filter(lambda v: np.linalg.norm(v) > 0.1).map(lambda v: v / np.linalg.norm(v))
headings = st.floats(-np.pi, np.pi)
half_turns = st.floats(0.0, np.pi)


def across(heading):
    """Returns a horizontal unit vector."""
    return np.array([np.cos(heading), np.sin(heading), 0.0])


def turn(angle, axis):
    return RotationMatrix(AngleAxis(angle, axis)).matrix()


def vee(S):
    return np.array([S[2, 1], S[0, 2], S[1, 0]])


@given(units, half_turns, units, half_turns)
def test_lees_error_is_the_papers(axis, angle, axis_d, angle_d):
    """Equation (10), of any desired and any actual attitude."""
    R, R_d = turn(angle, axis), turn(angle_d, axis_d)
    e_R = vee(0.5 * (R_d.T @ R - R.T @ R_d))
    np.testing.assert_allclose(lee_error(R_d.T @ R), e_R, atol=1e-15)
    # It is the gradient of Psi = 1/2 tr(I - R_d^T R), the paper's error function.
    psi = [0.5 * np.trace(np.eye(3) - R_d.T @ R @ turn(h, Z)) for h in (-1e-5, 1e-5)]
    assert e_R[2] == pytest.approx((psi[1] - psi[0]) / 2e-5, abs=1e-9)


@given(units, half_turns)
def test_lees_error_is_the_sine(axis, angle):
    np.testing.assert_allclose(lee_error(turn(angle, axis)), np.sin(angle) * axis, atol=1e-9)


def test_the_two_errors_differ_where_the_yaw_is_large():
    R = RollPitchYaw(0.3, -0.2, 2.5).ToRotationMatrix().matrix()
    np.testing.assert_allclose(lee_error(R), [0.08, 0.07, 0.56], atol=0.005)
    np.testing.assert_allclose(reduced_error(R, REST), [0.29, -0.20, 1.91], atol=0.005)


@given(units, st.floats(-1e-3, 1e-3), vectors)
def test_to_first_order_it_is_lees(axis, angle, w):
    E = turn(angle, axis)
    np.testing.assert_allclose(reduced_error(E, w), lee_error(E), atol=angle**2 + 1e-15)


@given(headings, half_turns, vectors)
def test_a_tilt_counts_twice_the_sine_of_half_its_angle(heading, angle, w):
    e = reduced_error(turn(angle, across(heading)), w)
    assert np.hypot(e[0], e[1]) == pytest.approx(2 * np.sin(angle / 2), abs=1e-6)
    if angle < 3.1:
        np.testing.assert_allclose(e, 2 * np.sin(angle / 2) * across(heading), atol=1e-9)


@given(headings, half_turns, half_turns)
def test_it_grows_all_the_way_to_half_a_turn(heading, one, other):
    """In tilt as well as in yaw."""
    low, high = sorted((one, other))
    for axis, part in ((across(heading), slice(2)), (Z, slice(2, 3))):
        small, large = (reduced_error(turn(a, axis), REST)[part] for a in (low, high))
        assert np.linalg.norm(small) <= np.linalg.norm(large) + 1e-12


@given(headings, vectors)
def test_at_half_a_turn_it_does_not_vanish(heading, w):
    E = turn(np.pi, across(heading))
    exact = np.diag([1.0, -1.0, -1.0])
    for e in (reduced_error(E, w), reduced_error(E, REST), reduced_error(exact, REST)):
        assert np.hypot(e[0], e[1]) == pytest.approx(2.0)  # there is no yaw to speak of


@given(units, vectors)
def test_at_half_a_turn_it_turns_on(n, w):
    """The moment, which is against the error, speeds up the rotation that there is."""
    e = tilt_error(-n, n, w)
    assert np.linalg.norm(e) == pytest.approx(2.0)
    assert e @ n == pytest.approx(0.0, abs=1e-12)
    across_n = w - (w @ n) * n
    if np.linalg.norm(across_n) > 1e-2:
        assert e @ w == pytest.approx(-2.0 * np.linalg.norm(across_n))


@pytest.mark.parametrize(
    "n", [[0, 0, 1], [0, 1, 0], [1, 0, 0], np.ones(3) / np.sqrt(3), -np.ones(3) / np.sqrt(3)]
)
def test_at_half_a_turn_and_at_rest_any_axis_is_there(n):
    n = np.array(n, float)
    e = tilt_error(-n, n, REST)
    assert np.linalg.norm(e) == pytest.approx(2.0) and e @ n == pytest.approx(0.0, abs=1e-12)


@given(headings, st.floats(0.0, 3.1), headings, vectors)
def test_yaw_and_tilt_are_told_apart(heading, tilt, yaw, w):
    """In whichever order they are made, neither part knows of the other."""
    swing, twist = turn(tilt, across(heading)), turn(yaw, Z)
    for E in (swing @ twist, twist @ swing):
        e = reduced_error(E, w)
        assert np.hypot(e[0], e[1]) == pytest.approx(2 * np.sin(tilt / 2), abs=1e-9)
        if abs(yaw) < 3.14:  # at half a turn, either sign will do
            assert e[2] == pytest.approx(2 * np.sin(yaw / 2), abs=1e-6)
    # The tilt as the turned body sees it.
    np.testing.assert_allclose(
        reduced_error(swing @ twist, w)[:2], (twist.T @ reduced_error(swing, w))[:2], atol=1e-6
    )


@given(units, st.floats(0.0, 3.1), headings, vectors)
def test_it_turns_with_the_body(axis, angle, yaw, w):
    """Seen from axes that are turned about z, it is the same vector."""
    T, E = turn(yaw, Z), turn(angle, axis)
    e = reduced_error(T.T @ E @ T, T.T @ w)
    np.testing.assert_allclose(e, T.T @ reduced_error(E, w), atol=1e-9)


@given(units, units, vectors, units, half_turns)
def test_tilt_errors_turn_with_all_vectors(n_d, n, w, axis, angle):
    T = turn(angle, axis)
    if n_d @ n > -0.999:
        e = tilt_error(n_d, n, w)
        np.testing.assert_allclose(tilt_error(T @ n_d, T @ n, T @ w), T @ e, atol=1e-9)
        assert e @ n == pytest.approx(0.0, abs=1e-9) and e @ n_d == pytest.approx(0.0, abs=1e-9)


@given(vectors, headings)
def test_lead_moment(moment, angle):
    expected = turn(-angle, Z) @ moment
    np.testing.assert_allclose(lead_moment(moment, angle), expected, atol=1e-12)
