import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.mavlink.commands import RefusedError, setpoint_of
from airrace.systems.control.setpoint import ATTITUDE, MOTORS, POSITION, RATES, VELOCITY
from tests.worlds.mavlink_client import (
    LEVEL,
    POSITION_ONLY,
    VELOCITY_ONLY,
    attitude,
    motors,
    position,
    rates,
    velocity,
)

ORIGIN = np.array([10.0, 20.0, 0.5])
IGNORE_YAW_RATE, IGNORE_YAW = 2048, 1024
BAD = [math.nan, math.inf, -math.inf]
numbers = st.floats(-9.0, 9.0)


@given(numbers, numbers, numbers, st.floats(0.0, 1.0))
def test_rates_are_those_of_frd(roll, pitch, yaw, thrust):
    setpoint = setpoint_of(rates(thrust, roll, pitch, yaw), ORIGIN)
    assert setpoint.kind == RATES and setpoint.thrust == thrust
    np.testing.assert_array_equal(setpoint.rates, [roll, -pitch, -yaw])
    inverted = setpoint_of(rates(thrust, roll, pitch, yaw), ORIGIN, inverted_rates=True)
    np.testing.assert_array_equal(inverted.rates, [-roll, -pitch, yaw])


def test_rates_to_be_ignored_are_none():
    setpoint = setpoint_of(rates(0.5, 1.0, 2.0, 3.0, mask=128 | 2), ORIGIN)
    np.testing.assert_array_equal(setpoint.rates, [1.0, 0.0, -3.0])


@pytest.mark.parametrize("thrust, expected", [(-0.5, 0.0), (1.5, 1.0)])
def test_thrust_is_a_share(thrust, expected):
    assert setpoint_of(rates(thrust), ORIGIN).thrust == expected


def test_an_attitude_is_normalised():
    setpoint = setpoint_of(attitude([2.0, 0.2, 0.4, 0.6], 0.3), ORIGIN)
    q = np.array([2.0, 0.2, -0.4, -0.6])
    assert setpoint.kind == ATTITUDE and setpoint.thrust == 0.3
    np.testing.assert_allclose(setpoint.quaternion, q / np.linalg.norm(q))


def test_velocities_and_positions_are_those_of_local_ned():
    setpoint = setpoint_of(velocity(1.0, 2.0, 3.0), ORIGIN)
    assert setpoint.kind == VELOCITY and not setpoint.has_yaw
    np.testing.assert_array_equal(setpoint.velocity, [1.0, -2.0, -3.0])
    setpoint = setpoint_of(position(1.0, 2.0, -3.0), ORIGIN)
    assert setpoint.kind == POSITION
    np.testing.assert_array_equal(setpoint.position, ORIGIN + [1.0, -2.0, 3.0])
    np.testing.assert_array_equal(setpoint.velocity, 0.0)


def test_yaw_wins_over_its_rate():
    both = velocity(
        0, 0, 0, yaw=0.5, yaw_rate=0.2, mask=VELOCITY_ONLY & ~IGNORE_YAW & ~IGNORE_YAW_RATE
    )
    setpoint = setpoint_of(both, ORIGIN)
    assert (setpoint.has_yaw, setpoint.yaw, setpoint.yaw_rate) == (1.0, -0.5, 0.0)
    rate = velocity(0, 0, 0, yaw=math.nan, yaw_rate=0.2, mask=VELOCITY_ONLY & ~IGNORE_YAW_RATE)
    setpoint = setpoint_of(rate, ORIGIN)
    assert (setpoint.has_yaw, setpoint.yaw_rate) == (0.0, -0.2)
    assert setpoint_of(rate, ORIGIN, inverted_rates=True).yaw_rate == 0.2


def test_motors_are_shares():
    setpoint = setpoint_of(motors(0.1, 0.2, 1.5, -1.0), ORIGIN)
    assert setpoint.kind == MOTORS
    np.testing.assert_allclose(setpoint.motors, [0.1, 0.2, 1.0, 0.0])


@pytest.mark.parametrize("bad", BAD)
def test_numbers_that_are_not_finite_are_refused(bad):
    for message in (
        rates(bad),
        rates(0.5, roll=bad),
        rates(0.5, pitch=bad),
        rates(0.5, yaw=bad),
        attitude([bad, 0.0, 0.0, 0.0], 0.5),
        attitude(LEVEL, bad),
        velocity(0.0, bad, 0.0),
        velocity(0.0, 0.0, 0.0, yaw=bad, mask=VELOCITY_ONLY & ~IGNORE_YAW),
        position(0.0, 0.0, bad),
        motors(0.1, bad, 0.1, 0.1),
    ):
        with pytest.raises(RefusedError, match="not finite"):
            setpoint_of(message, ORIGIN)


def test_what_is_to_be_ignored_may_be_anything():
    setpoint_of(rates(0.5, q=4 * [math.nan]), ORIGIN)
    setpoint_of(attitude(LEVEL, 0.5), ORIGIN)
    setpoint_of(velocity(1.0, 0.0, 0.0, yaw=math.nan, place=3 * [math.nan]), ORIGIN)
    setpoint_of(position(1.0, 0.0, 0.0, yaw=math.nan, yaw_rate=math.inf), ORIGIN)


def test_what_says_nothing_is_refused():
    with pytest.raises(RefusedError, match="neither position nor velocity"):
        setpoint_of(velocity(1.0, 1.0, 1.0, mask=VELOCITY_ONLY | POSITION_ONLY), ORIGIN)
    with pytest.raises(RefusedError, match="quaternion"):
        setpoint_of(attitude([0.0, 0.0, 0.0, 0.0], 0.5), ORIGIN)
