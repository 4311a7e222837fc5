"""The learner of rotors: it finds each rotor's thrust from what the drone does."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator

from airrace.systems.estimation.rotor_learner import RotorLearner
from airrace.vehicle import GRAVITY, load_vehicle

VEHICLES = {name: load_vehicle(name)[0] for name in ("Default", "StarOne")}


def learnt(vehicle, wrench, seconds=5.0, thrust=GRAVITY, disturbance=None, ground=0.0):
    """Returns the factors after a hover with a force along z (N) and moments beside the rotors.

    Args: ground: what the ground still seems to do in the first second (m/s^2).
    """
    n = len(vehicle.rotors)
    learner = RotorLearner(vehicle=vehicle, rate=50.0)
    simulator = Simulator(learner)
    context = simulator.get_mutable_context()
    speeds = np.sqrt(vehicle.mass * thrust / n / vehicle.thrust_coefficients)
    factors = np.ones(n)
    for time in np.arange(0.1, seconds + 1e-6, 0.1):
        # Who knows the factors finds less that is not explained.
        known = vehicle.allocation @ ((factors - 1.0) * vehicle.thrust_coefficients * speeds**2)
        rest = wrench - known
        along_z = np.array([0.0, 0.0, rest[0] / vehicle.mass + ground * (time < 0.95)])
        for name, value in {
            "filtered_estimate": np.array([0.0, 1.0, *[0.0] * 12]),
            "disturbance": along_z if disturbance is None else disturbance,
            "disturbance_moment": rest[1:],
            "rotor_speeds": speeds,
        }.items():
            learner.GetInputPort(name).FixValue(context, value)
        simulator.AdvanceTo(time)
        factors = learner.GetOutputPort("rotor_factors").Eval(context).copy()
    return factors


@settings(max_examples=10)
@given(
    st.lists(st.integers(-10, 10), min_size=4, max_size=4),
    st.lists(st.floats(-2e-3, 2e-3), min_size=4, max_size=4),
)
def test_each_rotor_of_four_is_found(percents, errors):
    """To the nearest half of a hundredth: what is less is the noise of a drone as in its file."""
    vehicle, off = VEHICLES["Default"], np.array(percents) / 100.0
    thrusts = np.full(4, vehicle.mass * GRAVITY / 4)
    found = learnt(vehicle, vehicle.allocation @ (thrusts * (off + errors)))
    np.testing.assert_allclose(found, 1.0 + off, atol=1e-9)


def test_of_eight_rotors_the_least_change_is_found():
    vehicle = VEHICLES["StarOne"]
    found = learnt(vehicle, np.array([-0.0501, 0.0, 0.0, 0.0]) * vehicle.mass * GRAVITY)
    np.testing.assert_allclose(found, 0.95, atol=1e-9)


def test_what_comes_from_the_side_is_no_weakness():
    vehicle = VEHICLES["Default"]
    found = learnt(vehicle, np.zeros(4), disturbance=np.array([3.0, -2.0, 0.0]))
    np.testing.assert_array_equal(found, 1.0)


def test_what_the_ground_did_is_no_strength():
    vehicle = VEHICLES["Default"]
    found = learnt(vehicle, np.zeros(4), seconds=2.5, ground=5.0)
    np.testing.assert_array_equal(found, 1.0)


@pytest.mark.parametrize(
    "options",
    [
        dict(seconds=1.9),
        dict(thrust=4.0),  # the ground may carry it
        dict(disturbance=np.full(3, np.nan)),
    ],
)
def test_nothing_is_said_before_it_has_flown(options):
    vehicle = VEHICLES["Default"]
    np.testing.assert_array_equal(learnt(vehicle, np.array([-1.0, 0.0, 0.0, 0.0]), **options), 1.0)


def test_there_is_a_most():
    vehicle = VEHICLES["Default"]
    found = learnt(vehicle, np.array([-0.5, 0.0, 0.0, 0.0]) * vehicle.mass * GRAVITY)
    np.testing.assert_allclose(found, 0.8)
