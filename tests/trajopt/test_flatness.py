import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from airrace.trajopt.flatness import attitude_from_force, heading_vectors

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
