"""Sticks that ask for angles: those at which the firmware asks for just the wanted rates."""

import numpy as np
import pytest
from pydrake.math import RollPitchYaw

from airrace.betaflight.angle_mode import AngleSticks
from airrace.betaflight.sticks import Sticks
from airrace.common.errors import UserError
from airrace.vehicle import load_vehicle
from tests.betaflight.test_sticks import DUMP, rates

SETTINGS = (
    DUMP.replace("aux 1 1 0 900 900 0 0", "aux 1 1 3 1700 2100 0 0")
    + "set angle_limit = 60\nset angle_p_gain = 80\n"
    + "set angle_earth_ref = 0\nset angle_feedforward = 0\n"
)


@pytest.fixture
def vehicle():
    return load_vehicle("Default")[0]


def estimate(roll, pitch, yaw):
    quaternion = RollPitchYaw(roll, pitch, yaw).ToQuaternion().wxyz()
    return lambda: np.array((0.0, *quaternion, *np.zeros(9)))


def test_angles_ask_for_the_wanted_rates_of_the_firmware(vehicle):
    sticks = AngleSticks(SETTINGS, vehicle)
    wanted = np.array((9.81, 1.0, -2.0, 0.5))
    f, roll, pitch, yaw_rate = sticks.command_of(wanted, estimate(0.3, -0.2, 2.0))
    assert (f, yaw_rate) == (9.81, 0.5)
    # Betaflight's pidLevel(): the rate is 8 / s times the angle that is missing.
    np.testing.assert_allclose((8.0 * (roll - 0.3), 8.0 * (pitch + 0.2)), (1.0, -2.0))


def test_a_full_stick_asks_for_the_greatest_angle(vehicle):
    sticks = AngleSticks(SETTINGS, vehicle)
    command = np.array((9.81, 0.5, -0.2, 1.0))
    told = [rates(sticks.channels(command)) for _ in range(200)]
    asked = np.mean(told, axis=0) * (60.0 / 600.0, 60.0 / 600.0, -1.0)
    np.testing.assert_allclose(asked, np.degrees(command[1:]), atol=0.1)
    assert sticks.channels(np.array((9.81, 2.0, -2.0, 0.0)))[:2] == [2000, 1000]


def test_its_switch_is_on_from_the_start_and_it_knows_the_true_attitude(vehicle):
    sticks = AngleSticks(SETTINGS, vehicle)
    assert sticks.at_rest(armed=False)[4:8] == [1000, 1000, 1000, 1900]
    assert sticks.at_rest(armed=True)[4:8] == [1000, 1000, 1900, 1900]
    state = np.arange(13.0)
    np.testing.assert_array_equal(sticks.shown_attitude(lambda: state), state[:4])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("aux 1 1 3 1700", "aux 1 2 3 1700", "add `aux 1 1 1 1700 2100 0 0`"),
        ("earth_ref = 0", "earth_ref = 100", r"`set angle_earth_ref = 0` \(it is 100\)"),
        ("angle_p_gain = 80", "", "do not say angle_p_gain"),
    ],
)
def test_settings_that_it_cannot_fly_are_one_sentence(vehicle, old, new, words):
    changed = SETTINGS.replace(old, new)
    Sticks(changed, vehicle)  # of rates it can
    with pytest.raises(UserError, match=words):
        AngleSticks(changed, vehicle)
