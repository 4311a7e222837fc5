"""The clock of plans: what is flown slower is still what a drone can fly."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from airrace.systems.planning.path_clock import REGULAR, PathClock, as_clock, clock_vector
from airrace.trajopt.flat_trajectory import flat_outputs
from tests.systems.planning.test_trajectory_tracker import PLAN

few = settings(max_examples=20)
STEP = 1e-3  # s
clocks = st.builds(
    lambda delay, slowing, rest: PathClock(25.0, delay, slowing, *rest),
    st.floats(0.0, 10.0),
    st.floats(0.0, 0.8),
    st.tuples(*[st.floats(-3.0, 3.0)] * 3),
)


def test_a_regular_clock_changes_nothing():
    for time in (3.0, 5.1, 30.0):
        np.testing.assert_array_equal(REGULAR.reference(PLAN, time), PLAN.reference(time))
        late = REGULAR._replace(delay=1.5)
        np.testing.assert_array_equal(late.reference(PLAN, time), PLAN.reference(time - 1.5))


@few
@given(clocks, st.floats(0.0, 0.2))
def test_each_derivative_is_that_of_the_one_before(clock, after):
    """By central differences; the pieces of a plan join with continuous snap."""
    before, now, then = (clock.derivatives(PLAN, 25.0 + after + h) for h in (-STEP, 0.0, STEP))
    slopes = (then - before)[:4] / (2.0 * STEP)
    scale = 1.0 + np.abs(now[1:]).max(axis=1, keepdims=True)
    np.testing.assert_allclose(slopes / scale, now[1:] / scale, atol=2e-2)


@few
@given(clocks, st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_a_clock_goes_on_as_it_says(clock, one, other):
    both = clock.after(25.0 + one).after(25.0 + one + other)
    np.testing.assert_allclose(both, clock.after(25.0 + one + other), atol=1e-9)
    exact = np.polyval(np.array([*clock[5:1:-1], clock.delay]) / [24, 6, 2, 1, 1], one)
    np.testing.assert_allclose(clock.after(25.0 + one).delay, exact, atol=1e-9)


def test_a_clock_that_stands_holds_the_drone():
    standing = PathClock(5.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    for time in (5.0, 7.0):
        held = standing.derivatives(PLAN, time)
        np.testing.assert_allclose(held[0], PLAN.derivatives(5.0)[0], atol=1e-9)
        np.testing.assert_array_equal(held[1:], 0.0)
        np.testing.assert_array_equal(standing.reference(PLAN, time), flat_outputs(held))


@given(clocks)
def test_a_vector_is_the_clock(clock):
    assert as_clock(clock_vector(clock)) == clock
