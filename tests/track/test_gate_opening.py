import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.track import Gate
from airrace.track.gate_opening import OPENING_SIZE, find
from airrace.track.square_gate import INNER, SquareGate
from tests.worlds.square_gates import square_gates

aside = st.floats(-1.2, 1.2)


def passes(gate, before, after):
    """Shows a line between two points in the gate's frame."""
    numbers = np.hstack(gate.opening())
    assert numbers.shape == (OPENING_SIZE,)
    return find(numbers, gate.X_WG @ np.array(before), gate.X_WG @ np.array(after))


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


@given(
    st.floats(-360, 360),
    st.floats(5.0, 15.0),
    st.floats(0.1, 2.0),
    st.floats(-9.0, 9.0),
    st.floats(-1.0, 13.0),
)
def test_between_pylons_it_reaches_from_axis_to_axis_and_from_the_ground_to_the_tips(
    heading_deg, spacing, distance, side, height
):
    gate = Gate([3.0, -7.0], heading_deg, spacing)
    middle = gate.p_WG * [1.0, 1.0, 0.0] + side * gate.rightward + [0.0, 0.0, height]
    ahead = distance * gate.forward
    share, offset = find(np.hstack(gate.opening()), middle - ahead, middle + ahead)
    if min(abs(abs(side) - spacing / 2), abs(height), abs(height - 12.0)) < 1e-6:
        return
    if abs(side) < spacing / 2 and 0.0 < height < 12.0:
        assert share == pytest.approx(0.5, abs=1e-6)
        assert offset == pytest.approx(np.hypot(side, height - 6.25), abs=1e-6)
    else:
        assert math.isnan(share) and math.isnan(offset)
