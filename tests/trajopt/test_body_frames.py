import numpy as np
import pytest

from airrace.trajopt.body_frames import SPACING, body_frames
from airrace.trajopt.reference import Reference
from airrace.vehicle import GRAVITY

RADIUS, SPEED, CLIMB = 20.0, 10.0, 1.0
TIMES = np.linspace(0.0, 12.0, 1201)


@pytest.fixture
def samples():
    """A screw around the z axis, with a nose that turns on its own."""
    rate, zero = SPEED / RADIUS, 0.0 * TIMES
    c, s = np.cos(rate * TIMES), np.sin(rate * TIMES)
    position = np.array([RADIUS * c, RADIUS * s, CLIMB * TIMES])
    velocity = np.array([-SPEED * s, SPEED * c, zero + CLIMB])
    acceleration = -rate * SPEED * np.array([c, s, zero])
    jerk = rate**2 * SPEED * np.array([s, -c, zero])
    snap = -(rate**2) * acceleration
    yaw, yaw_rate = 0.3 * TIMES, zero + 0.3
    return np.vstack(Reference(position, velocity, acceleration, jerk, snap, yaw, yaw_rate, zero))


def test_there_is_one_every_three_metres(samples):
    frames = body_frames(samples)
    speed = np.hypot(SPEED, CLIMB)
    assert frames.positions.shape[1] == int(speed * TIMES[-1] / SPACING) + 1
    times = frames.positions[2] / CLIMB
    np.testing.assert_allclose(np.diff(speed * times), SPACING, atol=1e-3)
    np.testing.assert_allclose(frames.positions[:, 0], [RADIUS, 0.0, 0.0])


def test_there_are_not_too_many(samples):
    far = samples.copy()
    far[0, -1] = 1e6
    positions, _, _ = body_frames(far)
    assert 1900 < positions.shape[1] < 2100


def test_axes_are_orthogonal_unit_vectors(samples):
    _, x, z = body_frames(samples)
    for axes in (x, z):
        np.testing.assert_allclose(np.linalg.norm(axes, axis=0), 1.0, atol=1e-12)
    np.testing.assert_allclose(np.sum(x * z, axis=0), 0.0, atol=1e-12)


def test_thrust_balances_gravity_and_turns_the_path(samples):
    positions, _, z = body_frames(samples)
    inwards = -positions[:2] / np.linalg.norm(positions[:2], axis=0)
    tilt = np.arctan2(SPEED**2 / RADIUS, GRAVITY)
    np.testing.assert_allclose(np.sum(z[:2] * inwards, axis=0), np.sin(tilt), atol=1e-4)
    np.testing.assert_allclose(z[2], np.cos(tilt), atol=1e-4)


def test_the_nose_is_above_or_below_the_yaw(samples):
    """In the plane of thrust and heading, and on the heading's side: Lee's equation (23)."""
    positions, x, z = body_frames(samples)
    yaw = 0.3 * positions[2] / CLIMB
    heading = np.array([np.cos(yaw), np.sin(yaw), 0.0 * yaw])
    triple = np.sum(np.cross(z, heading, axis=0) * x, axis=0)
    np.testing.assert_allclose(triple, 0.0, atol=1e-9)
    assert np.all(np.sum(x * heading, axis=0) > 0.0)


def test_at_rest_there_is_one_that_is_level():
    samples = np.zeros((18, 2))
    positions, x, z = body_frames(samples)
    np.testing.assert_allclose(np.hstack([positions, x, z]).T, [[0, 0, 0], [1, 0, 0], [0, 0, 1]])
