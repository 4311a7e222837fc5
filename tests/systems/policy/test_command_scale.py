"""What the numbers of an action stand for."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.systems.policy.command_scale import MAX_RATES, ctbr_scale, scaled, unscaled
from airrace.vehicle import load_vehicle

VEHICLE = load_vehicle("Default")[0]
SCALE = ctbr_scale(VEHICLE)


def test_its_ends():
    rates = np.array(MAX_RATES)
    np.testing.assert_allclose(scaled(-np.ones(4), SCALE), [0.0, *-rates], atol=1e-12)
    np.testing.assert_allclose(scaled(np.ones(4), SCALE), [34.0, *rates])


def test_what_is_beyond_counts_as_the_end():
    beyond = np.array([-7.0, 2.0, 1.5, -1.1])
    np.testing.assert_array_equal(scaled(beyond, SCALE), scaled(np.clip(beyond, -1, 1), SCALE))


@given(st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4))
def test_there_and_back(numbers):
    action = np.array(numbers)
    assert unscaled(scaled(action, SCALE), SCALE) == pytest.approx(action)


def test_float32_gives_no_float32():
    assert scaled(np.zeros(4, np.float32), SCALE).dtype == np.float64
