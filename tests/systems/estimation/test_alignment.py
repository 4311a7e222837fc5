import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.math.quaternion import rotation_matrix
from airrace.systems.estimation import alignment
from airrace.systems.estimation.kalman_update import error_between
from airrace.systems.estimation.navigation import Navigation
from airrace.track import Start
from airrace.track.start import pad_rotation, start_pose
from airrace.vehicle import GRAVITY
from tests.systems.estimation.motions import NOISE

starts = st.builds(
    Start, st.just([0.0, 0.0, 0.0]), st.floats(-180, 180), st.floats(0, 15), st.floats(0, 360)
)


@given(starts)
def test_the_attitude_is_that_of_a_drone_on_its_pad(start):
    R = start_pose(start, 0.3, 0.1).rotation().matrix()
    q = alignment.attitude_from(R.T @ [0.0, 0.0, 2.0], np.deg2rad(start.heading_deg))
    np.testing.assert_allclose(rotation_matrix(q), R, atol=1e-9)


@pytest.mark.parametrize("tilt", [0.0, 10.0])
def test_errors_at_rest_are_as_great_as_they_should_be(tilt):
    """Monte Carlo over biases; above all, tilt and bias are correlated."""
    rng, heading, total, count = np.random.default_rng(0), 0.7, 0.0, 400
    start = Start([0.0, 0.0, 0.0], np.rad2deg(heading), tilt, 30.0)
    R = pad_rotation(start).matrix() @ _turn(heading)
    q = alignment.attitude_from(R[2].copy(), heading)
    for _ in range(count):
        b_a, b_g = NOISE.accel_turn_on * rng.standard_normal(3), 0.01 * rng.standard_normal(3)
        noise = NOISE.accel * rng.standard_normal(3) / np.sqrt(0.5)
        force = GRAVITY * R[2] + b_a + noise
        w = b_g + NOISE.gyro / np.sqrt(0.5) * rng.standard_normal(3)
        rest = alignment.Rest(250, 0.5, w, force)
        estimate, gyro_bias, accel_bias, P = alignment.aligned(rest, heading, NOISE)
        zero = np.zeros(3)
        off = error_between(
            Navigation(0.5, q, zero, zero, b_g, b_a),
            Navigation(0.5, estimate, zero, zero, gyro_bias, accel_bias),
        )
        some = np.r_[0:3, 9:15]
        total += off[some] @ np.linalg.solve(P[np.ix_(some, some)], off[some]) / len(some)
        assert np.linalg.eigvalsh(P).min() > 0.0
    # One of nine, the heading, has no error at all.
    assert 0.6 < total / count < 1.2


def test_a_perfect_sensor_is_believed():
    rest = alignment.Rest(100, 0.2, np.zeros(3), np.array([0.0, 0.0, GRAVITY]))
    q, _, bias, P = alignment.aligned(
        rest, 0.0, NOISE._replace(gyro=0.0, accel=0.0, accel_turn_on=0.0)
    )
    np.testing.assert_allclose(q, [1, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(bias, 0.0, atol=1e-9)
    assert np.isfinite(P).all()
    assert np.linalg.eigvalsh(P).min() > 0.0


def _turn(heading):
    c, s = np.cos(heading), np.sin(heading)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def test_means_of_samples_come_in_pieces():
    history = np.zeros((10, 7))
    history[:, 0] = 0.02 - 0.002 * np.arange(10)
    history[:, 3] = np.arange(10)
    once = alignment.rested(alignment.NO_REST, history, -1.0, 0.02)
    half = alignment.rested(alignment.NO_REST, history, -1.0, 0.01)
    twice = alignment.rested(half, history, 0.01, 0.02)
    assert once.samples == twice.samples == 10
    np.testing.assert_allclose(once.angular_velocity, twice.angular_velocity)
    assert once.duration == pytest.approx(twice.duration) == 0.02
