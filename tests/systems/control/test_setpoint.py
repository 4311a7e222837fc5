import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from airrace.systems.control.setpoint import (
    NO_SETPOINT,
    SETPOINT_SIZE,
    as_setpoint,
    setpoint_vector,
)


@given(st.lists(st.floats(-9.0, 9.0), min_size=SETPOINT_SIZE, max_size=SETPOINT_SIZE))
def test_a_vector_is_its_parts_and_back(numbers):
    setpoint = as_setpoint(np.array(numbers))
    np.testing.assert_array_equal(setpoint_vector(setpoint), numbers)
    assert [np.size(part) for part in setpoint] == [np.size(part) for part in NO_SETPOINT]


def test_nothing_is_wanted_at_first():
    nothing = as_setpoint(setpoint_vector(NO_SETPOINT))
    assert not nothing.armed and nothing.kind == 0.0
    np.testing.assert_array_equal(nothing.quaternion, [1.0, 0.0, 0.0, 0.0])
