"""Drag in the air that a drone knows of."""

import numpy as np
import pytest

from airrace.vehicle.air import STILL, Air, air_vector, as_air, drag_acceleration, drag_rate

AIR = Air(0.1, 0.01, np.array([2.0, 0.0, 0.0]), axial_linear=-0.05, axial_quadratic=0.02)
UP = np.array([0.0, 0.0, 1.0])


def test_it_is_a_vector_and_back():
    assert air_vector(as_air(air_vector(AIR))).tolist() == air_vector(AIR).tolist()
    assert STILL.is_still and not AIR.is_still


@pytest.mark.parametrize(
    "velocity, expected",
    [
        ([2.0, 0.0, 0.0], [0.0, 0.0, 0.0]),  # with the wind
        ([12.0, 0.0, 0.0], [-2.0, 0.0, 0.0]),
        ([2.0, 0.0, -10.0], [0.0, 0.0, 3.5]),  # along the thrust
    ],
)
def test_drag_is_of_the_velocity_through_the_air(velocity, expected):
    found = drag_acceleration(np.array(velocity), UP, AIR)
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_the_rate_is_the_derivative_of_what_is_not_along_the_thrust():
    v, a, h = np.array([5.0, -3.0, 1.0]), np.array([4.0, 2.0, -6.0]), 1e-6
    before, after = (drag_acceleration(v + t * a, np.zeros(3), AIR) for t in (-h, h))
    np.testing.assert_allclose(drag_rate(v, a, AIR), (after - before) / (2 * h), atol=1e-6)
