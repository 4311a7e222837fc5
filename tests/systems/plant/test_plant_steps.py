import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.systems.plant.plant_steps import lead


@given(st.integers(0, 10**6), st.floats(0.0, 1.0), st.sampled_from([0.001, 0.002, 0.005]))
def test_the_end_of_the_step_is_shown(step, share, period):
    time = (step + share) * period
    shown = time + lead(time, period)
    assert shown / period == pytest.approx(round(shown / period), abs=1e-5)
    assert -1e-5 * period <= lead(time, period) <= period


def test_at_the_time_of_a_step_and_of_what_has_no_steps():
    assert lead(0.0, 0.001) == 0.0
    assert lead(3 * 0.001, 0.001) == pytest.approx(0.0, abs=1e-15)
    assert lead(0.005, 0.002) == pytest.approx(0.001)
    assert lead(0.1234, 0.0) == 0.0
