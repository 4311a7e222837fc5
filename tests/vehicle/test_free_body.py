import math

import numpy as np
import pytest

from airrace.common.jit import compiled
from airrace.math.quaternion import rotation_matrix
from airrace.vehicle import GRAVITY, free_body
from airrace.vehicle.free_body import Motion

LEVEL, NOTHING = (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
INERTIA = (0.02, 0.03, 0.05)


@compiled
def fly(motion, specific_force, moment, dt, steps):
    for _ in range(steps):
        motion = free_body.next_motion(motion, specific_force, moment, INERTIA, dt)
    return motion


def test_a_free_tumble_keeps_its_angular_momentum():
    before = Motion(LEVEL, NOTHING, (3.0, -2.0, 1.0), NOTHING)
    after = fly(before, NOTHING, NOTHING, 1e-5, 100_000)
    momenta = [
        R @ (np.array(INERTIA) * (R.T @ motion.angular_velocity))
        for motion in (before, after)
        for R in (rotation_matrix(np.array(motion.quaternion)),)
    ]
    np.testing.assert_allclose(momenta[1], momenta[0], atol=1e-5)


def test_a_moment_turns_about_its_axis():
    after = fly(Motion(LEVEL, NOTHING, NOTHING, NOTHING), NOTHING, (0.0, 0.0, 0.1), 1e-4, 10_000)
    assert after.angular_velocity == pytest.approx((0.0, 0.0, 2.0))
    angle = 2.0 * math.atan2(after.quaternion[3], after.quaternion[0])
    assert angle == pytest.approx(1.0, abs=1e-3)


def test_both_integrators_fall_alike():
    start = Motion(LEVEL, (0.0, 0.0, 9.0), NOTHING, (1.0, 0.0, 0.0))
    fallen = fly(start, NOTHING, NOTHING, 1e-4, 10_000)
    a = free_body.linear_acceleration(np.eye(3), NOTHING)
    assert a == (0.0, 0.0, -GRAVITY)
    p, v = free_body.at_constant_acceleration(start.position, start.velocity, a, 1.0)
    assert p == pytest.approx((1.0, 0.0, 9.0 - GRAVITY / 2))
    np.testing.assert_allclose(fallen.velocity, v)
    np.testing.assert_allclose(fallen.position, p, atol=1e-3)


def test_what_hovers_stays():
    start = Motion(LEVEL, (0.0, 0.0, 9.0), NOTHING, NOTHING)
    assert fly(start, (0.0, 0.0, GRAVITY), NOTHING, 1e-3, 1000).position == start.position
