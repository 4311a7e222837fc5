"""Thrust and rates become sticks, and outputs rotor speeds; no firmware is needed for this."""

import dataclasses as dc

import numpy as np
import pytest

from airrace.betaflight.sticks import Sticks
from airrace.common.errors import UserError
from airrace.vehicle import load_vehicle

DUMP = """# version
mixer QUADX
aux 0 0 2 1700 2100 0 0
aux 1 1 0 900 900 0 0
set motor_idle = 550
set thrust_linear = 0
set thr_expo = 0
set throttle_limit_type = OFF
set yaw_motors_reversed = ON
set min_check = 1050
set deadband = 10
set yaw_deadband = 0
set rates_type = ACTUAL
set rc_smoothing = OFF
set f_roll = 0
set f_pitch = 0
set f_yaw = 0
""" + "".join(
    f"set {axis}_rc_rate = 20\nset {axis}_srate = 60\nset {axis}_expo = 40\n"
    for axis in ("roll", "pitch", "yaw")
)


@pytest.fixture
def vehicle():
    return load_vehicle("Default")[0]


def rates(channels):
    """Betaflight's own way from sticks to rates (deg/s), of applyActualRates()."""
    wanted = []
    for value, dead in zip((channels[0], channels[1], channels[3]), (10, 10, 0)):
        off = value - 1500
        x = np.sign(off) * max(0, abs(off) - dead) / (500 - dead)
        bend = abs(x) * (x**5 * np.sign(x) * 0.4 + abs(x) * 0.6)
        wanted.append(x * 200 + np.sign(x) * 400 * bend)
    return np.array(wanted)


def test_sticks_ask_for_the_wanted_rates_on_average(vehicle):
    sticks = Sticks(DUMP, vehicle)
    for wanted in ((0.5, -1.0, 0.2), (3.0, 2.0, -4.0), (0.0, 0.01, 0.0)):
        told = [sticks.channels(np.array((9.81, *wanted))) for _ in range(200)]
        mean = np.mean([rates(channels) for channels in told], axis=0)
        np.testing.assert_allclose(mean, np.degrees(wanted) * (1, 1, -1), atol=0.2)


def motors_of(throttle, linear):
    """Betaflight's own way from a throttle, 0 to 1, to what motors get; see its mixer.c, pid.c."""
    mixed = throttle / (1 + (linear - 0.5 * linear**2) * (1 - throttle) ** 2)
    mixed *= 1 + linear * (1 - mixed) ** 2
    return np.full(16, 1000.0 + 1000 * (0.055 + 0.945 * mixed))


@pytest.mark.parametrize(("linear", "supply"), [(0, 1.0), (40, 1.0), (100, 1.0), (40, 0.8)])
def test_thrust_is_that_of_the_motors_speeds(vehicle, linear, supply):
    dump = DUMP.replace("thrust_linear = 0", f"thrust_linear = {linear}")
    sticks = Sticks(dump, vehicle)
    for thrust in (5.0, 9.81, 20.0):
        command = np.array((thrust, 0, 0, 0))
        throttles = [sticks.channels(command, supply)[2] for _ in range(200)]
        outputs = motors_of((np.mean(throttles) - 1050) / 950, linear / 100)
        speeds = sticks.rotor_speeds(outputs, supply)
        assert vehicle.thrust_coefficients @ speeds**2 == pytest.approx(thrust, rel=2e-3)


def test_sticks_stay_within_their_range(vehicle):
    sticks = Sticks(DUMP, vehicle)
    for _ in range(50):
        channels = sticks.channels(np.array((1e3, 1e3, -1e3, 1e3)))
    assert channels[:4] == [2000, 1000, 2000, 1000]
    assert sticks.channels(np.array((-1.0, 0, 0, 0)))[2] <= 1050


def test_the_arm_channel_is_the_settings(vehicle):
    sticks = Sticks(DUMP, vehicle)
    assert sticks.at_rest(armed=True)[6] == 1900 and sticks.at_rest(armed=False)[6] == 1000
    with pytest.raises(UserError, match=r"`aux 0 0 0 1700 2100 0 0` \(a channel that arms\)"):
        Sticks(DUMP.replace("1700 2100", "900 900"), vehicle)


def test_each_rotor_gets_the_output_of_its_place(vehicle):
    outputs = np.array([1100.0, 1200.0, 1300.0, 1400.0, *12 * [0.0]])
    shares = Sticks(DUMP, vehicle).rotor_speeds(outputs) / vehicle.max_speeds
    np.testing.assert_allclose(shares, (0.1, 0.2, 0.4, 0.3))


def test_what_it_cannot_fly_is_said(vehicle):
    with pytest.raises(UserError, match="do not say min_check"):
        Sticks(DUMP.replace("min_check", "mincheck"), vehicle)
    with pytest.raises(UserError, match=r"add `set yaw_motors_reversed = ON` \(it is OFF\)\.$"):
        Sticks(DUMP.replace("reversed = ON", "reversed = OFF"), vehicle)
    turning = [dc.replace(rotor, direction="cw") for rotor in vehicle.rotors]
    with pytest.raises(UserError, match="do not turn as Betaflight's mixers"):
        Sticks(DUMP, dc.replace(vehicle, rotors=turning))
    plus = dc.replace(
        vehicle, rotors=[dc.replace(r, position=[0.0, *r.position[1:]]) for r in vehicle.rotors]
    )
    with pytest.raises(UserError, match="arms that make an X, which the Default has not"):
        Sticks(DUMP, plus)
    star, _ = load_vehicle("StarOne")
    with pytest.raises(UserError, match="add `mixer OCTOX8`"):
        Sticks(DUMP, star)


def test_all_that_is_to_be_changed_is_said_at_once(vehicle):
    changed = DUMP
    for old, new in (
        ("ACTUAL", "QUICK"),
        ("thr_expo = 0", "thr_expo = 20"),
        ("rc_smoothing = OFF", "rc_smoothing = ON"),
        ("f_roll = 0", "f_roll = 100"),
        ("1700 2100", "900 900"),
    ):
        changed = changed.replace(old, new)
    with pytest.raises(UserError) as refused:
        Sticks(changed, vehicle)
    assert str(refused.value) == (
        "Betaflight's settings cannot fly the Default: add `set rates_type = ACTUAL` (it is QUICK)"
        ", `set thr_expo = 0` (it is 20), `set rc_smoothing = OFF` (it is ON), `set f_roll = 0` "
        "(it is 100), `aux 0 0 0 1700 2100 0 0` (a channel that arms)."
    )


def test_of_eight_rotors_the_lower_ones_come_last():
    star, _ = load_vehicle("StarOne")
    sticks = Sticks(DUMP.replace("QUADX", "OCTOX8"), star)
    outputs = np.array([*range(1100, 1900, 100), *8 * [0.0]])
    shares = sticks.rotor_speeds(outputs) / star.max_speeds
    np.testing.assert_allclose(shares, (0.2, 0.1, 0.3, 0.4, 0.6, 0.5, 0.7, 0.8))
    for place, share in zip((r.position for r in star.rotors), shares):
        assert (place[2] < 0.0) == (share > 0.45)
