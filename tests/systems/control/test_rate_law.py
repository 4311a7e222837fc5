"""The rate controller's law: what it asks of the rotors, and what it gives up at their limits."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from airrace.systems.control.rate_law import make_rate_parameters, rate_law, set_limited_thrusts
from airrace.vehicle import GRAVITY, load_vehicle
from airrace.vehicle.state import State, state_vector

RATE = 500.0
VEHICLES = {name: load_vehicle(name)[0] for name in ("Default", "StarOne")}
PARAMETERS = {name: make_rate_parameters(vehicle, RATE) for name, vehicle in VEHICLES.items()}
both_drones = pytest.mark.parametrize("drone", VEHICLES)
shares = st.floats(-1.0, 1.0)


def thrusts_for(drone, f, moment):
    p = PARAMETERS[drone]
    thrusts = np.empty(len(p.max_thrusts))
    set_limited_thrusts(thrusts, f, tuple(moment), p.inverse, p.max_thrusts)
    return thrusts


def turning(w):
    """Returns the state of a level drone with an angular velocity, (14,)."""
    zero = np.zeros(3)
    return state_vector(State(0.0, np.array([1.0, 0.0, 0.0, 0.0]), zero, w, zero))


def most(drone):
    """Returns the greatest total thrust and moments."""
    vehicle = VEHICLES[drone]
    return np.abs(vehicle.allocation) @ vehicle.max_thrusts


@both_drones
@settings(max_examples=200)
@given(f=st.floats(-0.5, 1.5), x=shares, y=shares, z=shares)
def test_thrusts_are_within_the_limits_and_yaw_goes_first(drone, f, x, y, z):
    scale = most(drone)
    wrench = scale * [f, x, y, z]
    thrusts = thrusts_for(drone, wrench[0], wrench[1:])
    limits = VEHICLES[drone].max_thrusts
    assert np.all(thrusts >= 0.0) and np.all(thrusts <= limits)
    got = VEHICLES[drone].allocation @ thrusts
    error = np.abs(got - wrench) / scale
    # Roll and pitch keep their direction, and are given up only where nothing else is left of yaw.
    tilting = got[1:3] / scale[1:3]
    assert np.abs(tilting[0] * y - tilting[1] * x) < 1e-9
    if error[1:3].max() > 1e-9:
        assert abs(got[3]) < 1e-9 * scale[3]
    # And what the rotors can give at once is given.
    unlimited = PARAMETERS[drone].inverse @ wrench
    if np.all(unlimited >= 0.0) and np.all(unlimited <= limits):
        np.testing.assert_allclose(thrusts, unlimited, atol=1e-9)


@both_drones
def test_thrust_yields_to_roll(drone):
    f, Mx, _, _ = most(drone)
    got = VEHICLES[drone].allocation @ thrusts_for(drone, f, [0.4 * Mx, 0.0, 0.0])
    assert got[1] == pytest.approx(0.4 * Mx)
    assert got[0] < 0.9 * f
    assert got[0] > 0.5 * f


@both_drones
def test_a_hover_is_kept(drone):
    vehicle, p = VEHICLES[drone], PARAMETERS[drone]
    weight = vehicle.mass * GRAVITY
    speeds = np.sqrt(p.inverse[:, 0] * weight / p.thrust_coefficients)
    command = np.empty(len(speeds))
    rate_law(command, np.array([weight, 0, 0, 0]), turning(np.zeros(3)), speeds, tuple(p))
    np.testing.assert_allclose(command, speeds, rtol=1e-9)


@both_drones
def test_a_spin_about_one_axis_is_not_turned_into_another(drone):
    vehicle, p = VEHICLES[drone], PARAMETERS[drone]
    w = np.array([2.0, 0.0, 1.0])
    f = vehicle.max_thrusts.sum() / 2
    speeds = np.sqrt(p.inverse[:, 0] * f / p.thrust_coefficients)
    # Rotors without lag: the commands are the speeds.
    command = np.empty(len(speeds))
    rate_law(command, np.array([f, *w]), turning(w), speeds, tuple(p._replace(overdrive=1.0)))
    _, *moment = vehicle.allocation @ (p.thrust_coefficients * command**2)
    J = np.array(vehicle.inertia)
    np.testing.assert_allclose((moment - np.cross(w, J * w)) / J, 0.0, atol=1e-9)
