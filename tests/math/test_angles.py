import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.math.angles import wrap_angle


@given(st.floats(-100.0, 100.0))
def test_it_differs_by_whole_turns_and_is_within_half_a_turn(angle):
    wrapped = wrap_angle(angle)
    assert -math.pi <= wrapped < math.pi
    assert math.remainder(wrapped - angle, 2 * math.pi) == pytest.approx(0.0, abs=1e-12)


def test_arrays():
    angles = np.array([-4.0, 0.5, 4.0])
    expected = [2 * np.pi - 4.0, 0.5, 4.0 - 2 * np.pi]
    np.testing.assert_allclose(wrap_angle(angles), expected)
