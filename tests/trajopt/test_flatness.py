import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from airrace.trajopt.flat_trajectory import pack
from airrace.trajopt.flatness import (
    attitude_from_force,
    axial_drag,
    heading_vectors,
    thrust_vectors,
)
from airrace.trajopt.reference import as_reference
from airrace.vehicle import GRAVITY
from airrace.vehicle.air import Air, drag_acceleration

vectors = st.tuples(*[st.floats(-6, 6)] * 3)
scalars = st.floats(-3, 3)


def attitude(t, a, j, s, yaw, rate, acceleration):
    """Attitude and rates at time t of a force that is a parabola in time."""
    force = np.array([a[0], a[1], a[2] + 9.81]) + np.multiply(j, t) + np.multiply(s, t * t / 2)
    heading = yaw + rate * t + acceleration * t * t / 2
    axes, w, alpha = attitude_from_force(
        force,
        np.add(j, np.multiply(s, t)),
        np.array(s),
        heading_vectors(np.cos(heading), np.sin(heading), rate + acceleration * t, acceleration),
    )
    return np.array(axes).T, np.array(w), np.array(alpha), force


@given(vectors, vectors, vectors, scalars, scalars, scalars)
def test_attitude_and_its_derivatives(a, j, s, yaw, rate, acceleration):
    assume(a[2] > -5)
    args = (a, j, s, yaw, rate, acceleration)
    R, w, alpha, force = attitude(0.0, *args)
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) > 0
    np.testing.assert_allclose(R[:, 2], force / np.linalg.norm(force), atol=1e-12)
    # The body's x axis lies over the heading: no part of it points left.
    assert abs(R[:, 0] @ np.cross(R[:, 2], [np.cos(yaw), np.sin(yaw), 0])) < 1e-9
    h = 1e-5
    before, after = attitude(-h, *args), attitude(h, *args)
    S = R.T @ (after[0] - before[0]) / (2 * h)
    rates = np.array([S[2, 1], S[0, 2], S[1, 0]])
    np.testing.assert_allclose(w, rates, atol=1e-4 * (1 + np.abs(w).max()))
    np.testing.assert_allclose(
        alpha, (after[1] - before[1]) / (2 * h), atol=1e-4 * (1 + np.abs(alpha).max())
    )


AIR = Air(0.08, 0.008, np.array([3.0, -2.0, 0.5]), -0.04, 0.005)


def moving(t, coefficients):
    """A sample of a polynomial in time, (18, 1)."""
    derivatives = np.zeros((5, 1, 4))
    for d in range(3):
        polynomial = np.polynomial.Polynomial(coefficients[d])
        for k in range(5):
            derivatives[k, 0, d] = polynomial.deriv(k)(t) if k else polynomial(t)
    return pack(derivatives)


@given(st.tuples(*[st.tuples(*[st.floats(-3, 3)] * 6)] * 3), st.floats(0.5, 3.0))
def test_thrust_through_the_air_and_its_derivatives(coefficients, unit):
    coefficients = np.array(coefficients)
    coefficients[:, 1] += 8.0  # m/s, so that the air's speed has derivatives
    before, now, after = (
        thrust_vectors(moving(t, coefficients), air=AIR) for t in (-1e-4, 0, 1e-4)
    )
    for k in range(2):
        np.testing.assert_allclose(now[k + 1], (after[k] - before[k]) / 2e-4, rtol=1e-3, atol=1e-2)
    r = moving(0.0, coefficients)[:, 0]
    b = now[0] / np.linalg.norm(now[0], axis=0)
    velocity = as_reference(moving(0.0, coefficients)).velocity
    along = axial_drag(velocity, b, 1.0, AIR)
    force = r[6:9] + [0.0, 0.0, GRAVITY] - drag_acceleration(r[3:6], b[:, 0], AIR)
    np.testing.assert_allclose((now[0] + along * b)[:, 0], force, atol=1e-3)
    # The same in another unit of time.
    scaled = moving(0.0, coefficients)
    scaled[:15] *= np.repeat(unit ** np.arange(5), 3)[:, None]
    for k, other in enumerate(thrust_vectors(scaled, np.array([unit]), AIR)):
        np.testing.assert_allclose(other / unit ** (k + 2), now[k], rtol=1e-9, atol=1e-9)
    scaled_along = axial_drag(unit * velocity, b, np.array([unit]), AIR)
    np.testing.assert_allclose(scaled_along / unit**2, along, rtol=1e-9, atol=1e-9)
