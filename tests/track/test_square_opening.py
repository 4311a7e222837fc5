import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.track.square_gate import INNER, SquareGate
from airrace.track.square_opening import OPENING_SIZE, find_square, opening_numbers
from tests.worlds.square_gates import square_gates

aside = st.floats(-1.2, 1.2)


def passes(gate, before, after):
    """Shows a line between two points in the gate's frame."""
    numbers = opening_numbers(gate)
    assert numbers.shape == (OPENING_SIZE,)
    return find_square(numbers, gate.X_WG @ np.array(before), gate.X_WG @ np.array(after))


@given(square_gates, st.floats(0.01, 2.0), st.floats(0.01, 2.0), aside, aside, aside, aside)
def test_a_line_passes_where_it_crosses_the_inner_square(gate, d, e, y, z, v, w):
    before, after = np.array([-d, y, z]), np.array([e, v, w])
    share, offset = passes(gate, before, after)
    expected = d / (d + e)
    middle = before + expected * (after - before)
    if abs(np.abs(middle[1:]).max() - INNER / 2) < 1e-6:
        return
    if np.abs(middle[1:]).max() < INNER / 2:
        assert share == pytest.approx(expected, abs=1e-6)
        assert offset == pytest.approx(np.linalg.norm(middle[1:]), abs=1e-6)
    else:
        assert math.isnan(share) and math.isnan(offset)
    # From behind it never counts.
    assert math.isnan(passes(gate, after, before)[0])


@pytest.mark.parametrize("x", [(-2.0, -1.0), (1.0, 2.0), (-1.0, math.nan), (math.nan, 1.0)])
def test_what_does_not_reach_or_is_no_number_does_not_pass(x):
    gate = SquareGate([0.0, 0.0, 3.0], yaw_deg=30.0, pitch_deg=20.0)
    assert math.isnan(passes(gate, [x[0], 0, 0], [x[1], 0, 0])[0])
