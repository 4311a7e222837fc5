import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.systems.planning.known_drone import expecting_drag, in_steps, known_limits
from airrace.trajopt.flight_limits import FlightLimits
from airrace.vehicle import load_vehicle
from airrace.vehicle.air import STILL_VECTOR, Air, air_vector, as_air

VEHICLE, _ = load_vehicle("Default")
EQUAL = np.ones(4)


@given(st.lists(st.floats(0.5, 1.2), min_size=4, max_size=4))
def test_thrusts_are_not_rounded_up_and_steps_stay_steps(factors):
    rounded, air = in_steps(np.array(factors), STILL_VECTOR)
    lost = factors - rounded
    assert (lost > -1e-12).all() and (lost < 0.005).all()
    again, _ = in_steps(rounded, air)
    np.testing.assert_array_equal(again, rounded)
    np.testing.assert_array_equal(air, STILL_VECTOR)


@pytest.mark.parametrize(
    "factors, air, share",
    [
        (EQUAL, STILL_VECTOR, 1.0),
        (np.array([1.0, 0.9, 1.0, 0.95]), STILL_VECTOR, 0.99),
        (EQUAL, air_vector(Air(0.1, 0.006, np.array([3.0, 0.0, 0.0]), 0.0, 0.0)), 0.97),
    ],
)
def test_thrust_is_kept_for_unequal_rotors_and_for_gusts(factors, air, share):
    limits = known_limits(FlightLimits(VEHICLE), factors, air)
    assert limits.thrust_share == pytest.approx(share)
    np.testing.assert_allclose(limits.vehicle.max_thrusts, factors * VEHICLE.max_thrusts)
    np.testing.assert_array_equal(air_vector(limits.air), air)


def test_a_drone_that_has_met_no_drag_counts_with_a_share_of_its_files():
    factors, vector = expecting_drag(EQUAL, VEHICLE, 0.5)
    np.testing.assert_allclose(factors, 0.85)
    air, mass = as_air(vector), VEHICLE.mass
    assert air.linear * mass == pytest.approx(0.5 * VEHICLE.drag.linear[0])
    assert (air.linear + air.axial_linear) * mass == pytest.approx(0.5 * VEHICLE.drag.linear[2])
    same, still = expecting_drag(EQUAL, VEHICLE, 0.0)
    np.testing.assert_array_equal(same, EQUAL)
    np.testing.assert_array_equal(still, STILL_VECTOR)
