import numpy as np

from airrace.systems.sensing.true_estimate import TrueEstimate


def test_it_is_the_truth_with_its_time():
    system = TrueEstimate()
    context = system.CreateDefaultContext()
    context.SetTime(2.5)
    state = np.arange(13.0)
    system.get_input_port().FixValue(context, state)
    estimate = system.get_output_port().Eval(context)
    np.testing.assert_array_equal(estimate, [2.5, *state])
