"""The explorer's reference between the times at which it is told."""

import numpy as np
import pytest

from airrace.systems.planning.held_reference import HeldReference
from airrace.trajopt.min_snap.leg import plan_leg
from airrace.trajopt.reference import as_reference


@pytest.fixture(scope="module")
def leg():
    start = np.zeros((5, 4))
    route = np.array([[10.0, 2.0, 5.0, 0.3], [25.0, -3.0, 5.0, 0.6]])
    return plan_leg(start, route, max_speed=8.0, max_acceleration=5.0)


def held(told, at, time):
    box = HeldReference()
    context = box.CreateDefaultContext()
    context.SetTime(time)
    box.GetInputPort("exploration_reference").FixValue(context, told)
    box.GetInputPort("values_time").FixValue(context, [at])
    return box.get_output_port().Eval(context)


@pytest.mark.parametrize("late", [0.0, 0.02, 0.1])
def test_it_is_where_the_trajectory_is(leg, late):
    for at in np.arange(0.1, leg.duration - late, 0.37):
        is_one_segment = not any(at < b < at + late for b in leg.breaks)
        shown, true = held(leg.reference(at), at, at + late), leg.reference(at + late)
        error = np.linalg.norm(as_reference(shown).position - as_reference(true).position)
        assert error < (1e-4 if is_one_segment else 0.02)


def test_after_a_while_it_stops(leg):
    told = leg.reference(2.0)
    stopped = held(told, 2.0, 3.0)
    np.testing.assert_array_equal(stopped, held(told, 2.0, 9.0))
    reference = as_reference(stopped)
    assert not np.any([*reference[1:5]]) and reference.yaw_rate == 0.0
    np.testing.assert_allclose(
        reference.position, as_reference(held(told, 2.0, 2.3)).position, atol=1e-12
    )


def test_a_reference_of_the_future_is_shown_as_it_is(leg):
    told = leg.reference(2.0)
    np.testing.assert_array_equal(held(told, 5.0, 4.99), told)
