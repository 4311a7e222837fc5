import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator

from airrace.systems.sensing.state_estimate import StateEstimate, TrueEstimate, plant_lead
from airrace.vehicle.state import as_state

TRUTH = np.array([1.0, 0, 0, 0, 1, 2, 3, 0.1, 0.2, 0.3, 10, -5, 1])


def sample(seconds, **kwargs):
    """Returns the estimates of a drone that does not move, one a row."""
    system = StateEstimate(rate=200.0, **kwargs)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    system.GetInputPort("state").FixValue(context, TRUTH)
    simulator.Initialize()
    rows = [system.get_output_port().Eval(context)]
    for k in range(1, round(200 * seconds)):
        simulator.AdvanceTo(k / 200 + 0.001)
        rows.append(system.get_output_port().Eval(context))
    return np.array(rows)


def test_without_noise_it_is_the_truth_from_the_first_moment():
    rows = sample(0.1)
    np.testing.assert_array_equal(rows[:, 1:], np.tile(TRUTH, (len(rows), 1)))
    np.testing.assert_allclose(as_state(rows.T).time, np.arange(len(rows)) / 200, atol=1e-12)


def test_reference_noise():
    rows = sample(20.0, position_sigma=0.005, velocity_sigma=0.03, seed=1)
    error = rows[:, 1:] - TRUTH
    position, velocity = error[:, 4:7], error[:, 10:13]
    assert position.std(axis=0) == pytest.approx([0.005] * 3, rel=0.1)
    assert velocity.std(axis=0)[:2] == pytest.approx([0.3, 0.15], rel=0.1)
    assert abs(np.corrcoef(position[:, 0], position[:, 1])[0, 1]) < 0.1
    exact = np.r_[0:4, 7:10, 12]
    np.testing.assert_array_equal(error[:, exact], 0.0)


def test_seed():
    one, again, other = (
        sample(0.5, position_sigma=0.005, velocity_sigma=0.03, seed=s) for s in (1, 1, 2)
    )
    np.testing.assert_array_equal(one, again)
    assert not np.array_equal(one, other)


def test_between_steps_of_the_plant_the_estimate_is_of_its_own_time():
    system = StateEstimate(rate=200.0, state_period=0.002)
    v, w = np.array([20.0, -3.0, 1.0]), np.array([0.0, 0.0, 4.0])

    def state(time):
        return np.concatenate([[np.cos(2 * time), 0, 0, np.sin(2 * time)], time * v, w, v])

    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    for time, shown in ((0.0, 0.0), (0.005, 0.006), (0.01, 0.01), (0.015, 0.016)):
        system.GetInputPort("state").FixValue(context, state(shown))
        simulator.AdvanceTo(time + 1e-4)
        estimate = system.get_output_port().Eval(context)
        np.testing.assert_allclose(estimate, [time, *state(time)], rtol=0, atol=1e-8)


@given(st.integers(0, 10**6), st.floats(0.0, 1.0), st.sampled_from([0.001, 0.002, 0.005]))
def test_the_end_of_the_step_is_shown(step, share, period):
    time = (step + share) * period
    shown = time + plant_lead(time, period)
    assert shown / period == pytest.approx(round(shown / period), abs=1e-5)
    assert -1e-5 * period <= plant_lead(time, period) <= period


def test_at_the_time_of_a_step_and_of_what_has_no_steps():
    assert plant_lead(0.0, 0.001) == 0.0
    assert plant_lead(3 * 0.001, 0.001) == pytest.approx(0.0, abs=1e-15)
    assert plant_lead(0.005, 0.002) == pytest.approx(0.001)
    assert plant_lead(0.1234, 0.0) == 0.0


def test_a_true_estimate_is_the_truth_with_its_time():
    system = TrueEstimate()
    context = system.CreateDefaultContext()
    context.SetTime(2.5)
    state = np.arange(13.0)
    system.get_input_port().FixValue(context, state)
    estimate = system.get_output_port().Eval(context)
    np.testing.assert_array_equal(estimate, [2.5, *state])
