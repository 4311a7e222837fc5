import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from airrace.mavlink import commands
from airrace.mavlink.commands import RefusedError, Situation, make_airframe
from airrace.mavlink.dialects import DIALECTS
from airrace.systems.control.setpoint import (
    ATTITUDE,
    MOTORS,
    NO_SETPOINT,
    POSITION,
    RATES,
    VELOCITY,
)
from airrace.vehicle import load_vehicle
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

OFFICIAL, CLEAN = DIALECTS["official"], DIALECTS["none"]
VADR, _ = load_vehicle("vadr")
ORIGIN, PLACE, YAW = np.array([10.0, 20.0, 0.5]), np.array([13.0, 21.0, 2.5]), np.pi / 2
IGNORE_YAW_RATE, IGNORE_YAW = 2048, 1024
BAD = [math.nan, math.inf, -math.inf]
numbers = st.floats(-9.0, 9.0)


def setpoint_of(message, dialect=CLEAN, last=NO_SETPOINT):
    """Returns the set-point of a message, for a drone that looks along the world's y axis."""
    frame = make_airframe(VADR, dialect)
    return commands.setpoint_of(message, dialect, Situation(frame, ORIGIN, PLACE, YAW, last))


@given(numbers, numbers, numbers, st.floats(0.01, 1.0))
def test_rates_are_those_of_frd_or_mirrored(roll, pitch, yaw, thrust):
    setpoint = setpoint_of(rates(thrust, roll, pitch, yaw))
    assert setpoint.kind == RATES and setpoint.thrust == thrust
    np.testing.assert_array_equal(setpoint.rates, [roll, -pitch, -yaw])
    # Officially, those of a stick are FRD's, and only those in rad/s are mirrored.
    turned = setpoint_of(rates(thrust, roll, pitch, yaw), OFFICIAL).rates
    np.testing.assert_array_equal(np.sign(turned), np.sign(setpoint.rates))
    plain = setpoint_of(rates(thrust, roll, pitch, yaw, mask=144), OFFICIAL).rates
    np.testing.assert_allclose(plain, -setpoint.rates * [0.98, 0.98, 0.89])


@pytest.mark.parametrize(
    "wanted, gains",
    [(0.1 * np.pi, [2.44, 2.44, 2.23]), (0.8 * np.pi, [3.09, 3.06, 2.89]), (4.0, [3.4, 3.3, 3.2])],
)
def test_the_official_stick_turns_more_the_further_it_is_pushed(wanted, gains):
    """As one entrant measured at a tenth and at 0.8 of its way, to 2 %; it ends at pi."""
    for sign in (1.0, -1.0):
        turned = setpoint_of(rates(0.3, *3 * [sign * wanted]), OFFICIAL).rates
        assert turned / (sign * wanted) == pytest.approx(gains * np.array([1, -1, -1]), rel=0.02)


def test_rates_to_be_ignored_are_none():
    setpoint = setpoint_of(rates(0.5, 1.0, math.nan, 3.0, mask=128 | 2))
    np.testing.assert_array_equal(setpoint.rates, [1.0, 0.0, -3.0])


@pytest.mark.parametrize("thrust, expected", [(-0.5, 0.0), (1.5, 1.0)])
def test_thrust_is_a_share(thrust, expected):
    assert setpoint_of(rates(thrust)).thrust == expected


def test_official_thrust_hovers_as_measured_and_grows_as_measured():
    most = VADR.max_thrusts.sum() / VADR.mass  # m/s^2
    thrusts = np.array([0.0, 0.05, 0.266, 0.286, 0.485, 1.0, 2.0])
    forces = [setpoint_of(rates(u), OFFICIAL).thrust * most for u in thrusts]
    expected = [0.0, 0.8, 9.81, 9.81 + 0.02 * 53.5, 24.5, 51.7, 51.7]  # m/s^2
    assert forces == pytest.approx(expected, abs=0.02)
    # As one published model flies: at full thrust, drag holds its climb at 30.8 m/s.
    climbs = np.sqrt((np.array([24.5, 51.7]) - 9.81) / 0.0436)
    assert climbs == pytest.approx([16.9, 30.8], rel=0.1)


@pytest.mark.parametrize("dialect", DIALECTS)
def test_rates_without_thrust_leave_a_drone_that_stands_still(dialect):
    dialect = DIALECTS[dialect]
    assert setpoint_of(rates(0.0, 1.0, 2.0, 3.0), dialect) is NO_SETPOINT
    # One that flies turns without thrust, too.
    flying = NO_SETPOINT._replace(kind=RATES, thrust=0.4)
    assert setpoint_of(rates(0.0, 1.0, 2.0, 3.0), dialect, flying).kind == RATES


def test_an_ignored_thrust_keeps_its_last_value_or_hovers():
    last = NO_SETPOINT._replace(kind=RATES, thrust=0.4)
    assert setpoint_of(rates(math.nan, mask=128 | 64), last=last).thrust == 0.4
    hover = VADR.mass * 9.81 / VADR.max_thrusts.sum()
    assert setpoint_of(rates(math.nan, mask=128 | 64)).thrust == pytest.approx(hover, rel=1e-3)


def test_an_attitude_is_normalised():
    setpoint = setpoint_of(attitude([2.0, 0.2, 0.4, 0.6], 0.3))
    q = np.array([2.0, 0.2, -0.4, -0.6])
    assert setpoint.kind == ATTITUDE and setpoint.thrust == 0.3 and setpoint.has_yaw
    np.testing.assert_allclose(setpoint.quaternion, q / np.linalg.norm(q))
    np.testing.assert_array_equal(setpoint.rates, 0.0)
    # The official one is read as x forward, y left, z up.
    official = setpoint_of(attitude(q, 0.3), OFFICIAL)
    np.testing.assert_allclose(official.quaternion, setpoint.quaternion)


def test_an_attitude_with_a_yaw_rate_alone_leaves_the_yaw_to_it():
    setpoint = setpoint_of(rates(0.3, math.nan, math.nan, 0.5, mask=3))
    assert setpoint.kind == ATTITUDE and not setpoint.has_yaw
    np.testing.assert_array_equal(setpoint.rates, [0.0, 0.0, -0.5])


def test_an_attitude_with_all_rates_has_them_on_top():
    setpoint = setpoint_of(rates(0.3, 0.1, 0.2, 0.5, mask=0))
    assert setpoint.kind == ATTITUDE and setpoint.has_yaw
    np.testing.assert_array_equal(setpoint.rates, [0.1, -0.2, -0.5])


def test_velocities_and_positions_are_those_of_local_ned():
    setpoint = setpoint_of(velocity(1.0, 2.0, 3.0))
    assert setpoint.kind == VELOCITY and not setpoint.has_yaw
    np.testing.assert_array_equal(setpoint.velocity, [1.0, -2.0, -3.0])
    setpoint = setpoint_of(position(1.0, 2.0, -3.0))
    assert setpoint.kind == POSITION
    np.testing.assert_array_equal(setpoint.position, ORIGIN + [1.0, -2.0, 3.0])
    np.testing.assert_array_equal(setpoint.velocity, 0.0)


NAN = math.nan


def test_a_height_is_held_while_a_velocity_is_flown():
    """Position in z, velocity in x and y; what is ignored may be anything."""
    message = velocity(1.0, 2.0, NAN, place=(NAN, NAN, -1.5), mask=0b110111100011)
    setpoint = setpoint_of(message)
    assert setpoint.kind == POSITION
    np.testing.assert_array_equal(setpoint.has_position, [0, 0, 1])
    np.testing.assert_array_equal(setpoint.has_velocity, [1, 1, 1])
    np.testing.assert_array_equal(setpoint.velocity, [1.0, -2.0, 0.0])
    assert setpoint.position[2] == ORIGIN[2] + 1.5


def test_a_position_wins_over_a_velocity_in_the_official_dialect():
    both = velocity(1.0, 2.0, 3.0, place=(4.0, 5.0, 6.0), mask=0b110111000000)
    np.testing.assert_array_equal(setpoint_of(both).velocity, [1.0, -2.0, -3.0])
    np.testing.assert_array_equal(setpoint_of(both, OFFICIAL).velocity, 0.0)


@pytest.mark.parametrize("mask, factor", [(3135, 1.0), (3647, 1.0 / 0.9)])
def test_an_acceleration_or_force_alone_is_flown(mask, factor):
    message = velocity(NAN, NAN, NAN, place=3 * [NAN], mask=mask)
    message.afx, message.afy, message.afz = 1.0, 2.0, 3.0
    setpoint = setpoint_of(message, OFFICIAL)
    assert setpoint.kind == VELOCITY
    np.testing.assert_allclose(setpoint.acceleration, factor * np.array([1.0, -2.0, -3.0]))
    np.testing.assert_array_equal(setpoint.has_velocity, 0.0)


@pytest.mark.parametrize("mask, kind", [(3576, POSITION), (3527, VELOCITY)])
def test_the_masks_of_clients_are_understood(mask, kind):
    assert setpoint_of(velocity(0.0, 0.0, 0.0, mask=mask), OFFICIAL).kind == kind


@pytest.mark.parametrize(
    "frame, begin, turned",
    [(1, ORIGIN, False), (7, PLACE, False), (8, PLACE, True), (9, PLACE, True), (12, PLACE, True)],
)
def test_frames_begin_where_they_say(frame, begin, turned):
    """Forward is along the world's y axis, to which the drone looks."""
    message = velocity(1.0, 0.0, 0.0, place=(2.0, 0.0, -1.0), mask=0b110111000000)
    message.coordinate_frame = frame
    setpoint, ahead = setpoint_of(message), np.array([0, 1, 0] if turned else [1, 0, 0])
    np.testing.assert_allclose(setpoint.position, begin + 2.0 * ahead + [0, 0, 1], atol=1e-9)
    np.testing.assert_allclose(setpoint.velocity, ahead, atol=1e-9)
    official = setpoint_of(message, OFFICIAL)  # which takes all for LOCAL_NED
    np.testing.assert_allclose(official.position, ORIGIN + [2.0, 0.0, 1.0])


def test_a_frame_of_another_kind_is_refused():
    message = position(1.0, 0.0, 0.0)
    message.coordinate_frame = mavlink.MAV_FRAME_GLOBAL
    with pytest.raises(RefusedError, match="coordinate_frame 0 is not followed: take one of 1, 7"):
        setpoint_of(message)
    half = velocity(1.0, 0.0, 0.0, mask=VELOCITY_ONLY | 16)
    half.coordinate_frame = 8
    with pytest.raises(RefusedError, match="go together"):
        setpoint_of(half)


def test_yaw_wins_over_its_rate():
    both = velocity(
        0, 0, 0, yaw=0.5, yaw_rate=0.2, mask=VELOCITY_ONLY & ~IGNORE_YAW & ~IGNORE_YAW_RATE
    )
    setpoint = setpoint_of(both)
    assert (setpoint.has_yaw, setpoint.yaw, setpoint.yaw_rate) == (1.0, -0.5, 0.0)
    rate = velocity(0, 0, 0, yaw=math.nan, yaw_rate=0.2, mask=VELOCITY_ONLY & ~IGNORE_YAW_RATE)
    setpoint = setpoint_of(rate)
    assert (setpoint.has_yaw, setpoint.yaw_rate) == (0.0, -0.2)


def test_the_last_yaw_is_kept_from_one_position_to_the_next():
    first = setpoint_of(position(1.0, 0.0, 0.0, yaw=0.5, mask=POSITION_ONLY & ~IGNORE_YAW))
    second = setpoint_of(position(2.0, 0.0, 0.0), last=first)
    assert (second.has_yaw, second.yaw) == (1.0, -0.5)
    assert not setpoint_of(position(2.0, 0.0, 0.0), last=NO_SETPOINT).has_yaw


def test_a_yaw_alone_keeps_the_last_position():
    first = setpoint_of(position(1.0, 2.0, -3.0))
    only_yaw = velocity(NAN, NAN, NAN, yaw=0.5, place=3 * [NAN], mask=0b100111111111)
    after = setpoint_of(only_yaw, last=first)
    np.testing.assert_array_equal(after.position, first.position)
    assert (after.kind, after.has_yaw, after.yaw) == (POSITION, 1.0, -0.5)
    alone = setpoint_of(only_yaw)
    assert alone.kind == VELOCITY and not alone.velocity.any()


@pytest.mark.parametrize("dialect, order", [(OFFICIAL, [2, 0, 1, 3]), (CLEAN, [0, 1, 2, 3])])
def test_motors_are_shares_in_the_order_of_the_dialect(dialect, order):
    """Ours are front right, rear left, front left, rear right."""
    setpoint = setpoint_of(motors(0.1, -1.0, 2.0, 0.4), dialect)
    assert setpoint.kind == MOTORS
    np.testing.assert_allclose(setpoint.motors[order], [0.1, 0.0, 1.0, 0.4], atol=1e-7)


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
            setpoint_of(message)


def test_what_is_to_be_ignored_may_be_anything():
    setpoint_of(rates(0.5, q=4 * [math.nan]))
    setpoint_of(rates(0.5, *3 * [math.nan], mask=7))
    setpoint_of(velocity(1.0, 0.0, 0.0, yaw=math.nan, place=3 * [math.nan]))
    setpoint_of(position(1.0, 0.0, 0.0, yaw=math.nan, yaw_rate=math.inf))


@pytest.mark.parametrize(
    "message, words",
    [
        (velocity(1.0, 1.0, 1.0, mask=VELOCITY_ONLY | POSITION_ONLY), "type_mask 3583 of a pos"),
        (rates(0.5, mask=199), "type_mask 199 of an attitude asks for nothing"),
        (rates(0.5, mask=128 | 32), "thrust with a direction"),
        (attitude([0.0, 0.0, 0.0, 0.0], 0.5), "quaternion"),
    ],
)
def test_what_says_nothing_is_refused(message, words):
    with pytest.raises(RefusedError, match=words):
        setpoint_of(message)
