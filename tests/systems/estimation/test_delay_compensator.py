"""The compensator foresees where a drone will be under the commands that it has been sent."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from airrace.systems.estimation.delay_compensator import DelayCompensator
from airrace.vehicle import GRAVITY, load_vehicle
from airrace.vehicle.state import STATE_SIZE, as_state

VEHICLE, _ = load_vehicle("Default")
HOVER = np.full(4, np.sqrt(VEHICLE.mass * GRAVITY / 4 / 1e-3))


def fixed(estimate, speeds, command, delay, until=0.3, **kwargs):
    """Returns the outputs of a compensator with constant inputs."""
    box = DelayCompensator(vehicle=VEHICLE, rate=500.0, **kwargs)
    simulator = Simulator(box)
    context = simulator.get_mutable_context()
    for name, value in (
        ("state_estimate", estimate),
        ("rotor_speeds", speeds),
        ("rotor_speed_command", command),
    ):
        box.GetInputPort(name).FixValue(context, value)
    box.set_delay(context, delay)
    simulator.AdvanceTo(until)
    return (
        box.GetOutputPort("state_estimate").Eval(context),
        box.GetOutputPort("rotor_speeds").Eval(context),
    )


def estimate(velocity=(8.0, 0.0, 0.0)):
    result = np.zeros(STATE_SIZE)
    result[0], result[1], as_state(result).position[:] = 0.25, 1.0, [1.0, 2.0, 5.0]
    as_state(result).velocity[:] = velocity
    return result


def test_delays_are_rounded_and_never_longer_than_the_model_is_good_for():
    box = DelayCompensator(vehicle=VEHICLE, rate=500.0)
    assert box.rounded(0.003, 0.0) == box.rounded(0.003, 0.05) == 0.0
    assert box.rounded(0.0411, 0.0) == pytest.approx(0.042)
    assert box.rounded(0.0441, 0.042) == 0.042
    assert box.rounded(0.7, 0.05) == pytest.approx(0.25)
    assert box.rounded(0.9, box.rounded(0.7, 0.05)) == pytest.approx(0.25)


def test_without_a_delay_nothing_is_touched():
    given = estimate()
    state, speeds = fixed(given, HOVER, HOVER, 0.0)
    np.testing.assert_array_equal(state, given)
    np.testing.assert_array_equal(speeds, HOVER)


@pytest.mark.slow
def test_a_hovering_drone_goes_on_as_it_does():
    state, speeds = fixed(estimate(), HOVER, HOVER, 0.04)
    assert as_state(state).time == pytest.approx(0.29)
    np.testing.assert_allclose(as_state(state).position, [1.32, 2.0, 5.0], atol=1e-6)
    np.testing.assert_allclose(as_state(state).velocity, [8.0, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(speeds, HOVER)


@pytest.mark.parametrize("until", [0.25, 0.25 + 1e-4, 0.2531, 0.2875, 0.3, 0.45])
def test_an_estimate_that_is_old_is_carried_to_the_present(until):
    """Whatever the delay of the link is, and also by parts of a period."""
    state, _ = fixed(estimate(), HOVER, HOVER, 0.0, until=until, to_present=True)
    assert as_state(state).time == pytest.approx(until)
    expected = [1.0 + 8.0 * (until - 0.25), 2.0, 5.0]
    np.testing.assert_allclose(as_state(state).position, expected, atol=1e-6)


def test_nothing_is_carried_further_than_the_model_is_good_for():
    state, _ = fixed(estimate(), HOVER, HOVER, 0.0, until=0.9, to_present=True)
    assert as_state(state).time == pytest.approx(0.5)


def test_on_the_pad_it_does_not_fall_through_the_ground():
    state, speeds = fixed(estimate((0, 0, 0)), 0.65 * HOVER, HOVER, 0.04)
    assert as_state(state).time == pytest.approx(0.29)
    np.testing.assert_array_equal(as_state(state).position, [1.0, 2.0, 5.0])
    np.testing.assert_allclose(speeds, HOVER * (1 - 0.35 * np.exp(-0.04 / 0.03)), rtol=0.01)


def test_a_rotor_that_stands_still_is_shown_so():
    standing = HOVER * [1, 0, 1, 1]
    _, speeds = fixed(estimate(), standing, HOVER, 0.1)
    np.testing.assert_allclose(speeds, standing)


def test_not_a_number_goes_through():
    given = estimate((np.nan, 0, 0))
    state, _ = fixed(given, HOVER, HOVER, 0.04)
    np.testing.assert_array_equal(state, given)
