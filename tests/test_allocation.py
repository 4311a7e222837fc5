import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from airrace.allocation import Allocator
from airrace.vehicle import load_vehicle

VEHICLE, _ = load_vehicle("Default")
ALLOCATOR = Allocator(VEHICLE.allocation, VEHICLE.max_thrusts)
moments = st.floats(-2, 2)


@given(st.lists(st.floats(0, 8.5), min_size=4, max_size=4))
def test_exact_within_the_limits(thrusts):
    wrench = VEHICLE.allocation @ thrusts
    np.testing.assert_allclose(ALLOCATOR.allocate(wrench), thrusts, atol=1e-9)


@given(st.floats(-50, 100), moments, moments, st.floats(-1, 1))
def test_never_outside_the_limits(f, mx, my, mz):
    thrusts = ALLOCATOR.allocate(np.array([f, mx, my, mz]))
    assert np.all(thrusts >= 0) and np.all(thrusts <= VEHICLE.max_thrusts)


@given(st.floats(0, 40), st.floats(-0.6, 0.6), st.floats(-0.6, 0.6), st.floats(-1, 1))
def test_roll_and_pitch_survive_saturation(f, mx, my, mz):
    """Roll and pitch that some thrust can produce are produced."""
    wrench = np.array([f, mx, my, mz])
    achieved = VEHICLE.allocation @ ALLOCATOR.allocate(wrench)
    np.testing.assert_allclose(achieved[1:3], wrench[1:3], atol=1e-9)


def test_yaw_gives_way_before_thrust():
    # All of the thrust leaves no room for yaw.
    wrench = np.array([34.0, 0.0, 0.0, 0.1])
    achieved = VEHICLE.allocation @ ALLOCATOR.allocate(wrench)
    np.testing.assert_allclose(achieved, [34.0, 0, 0, 0], atol=1e-9)
    # Some room: some of it.
    wrench = np.array([30.0, 0.0, 0.0, 0.1])
    achieved = VEHICLE.allocation @ ALLOCATOR.allocate(wrench)
    np.testing.assert_allclose(achieved, [30.0, 0, 0, 0.04], atol=1e-9)
