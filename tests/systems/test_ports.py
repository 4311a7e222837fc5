"""What a vector port shows, without a copy."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from pydrake.systems.primitives import PassThrough

from airrace.systems.ports import read_vector


@given(st.lists(st.floats(allow_nan=False), min_size=1, max_size=9))
def test_it_is_what_the_port_shows_and_no_copy(values):
    system = PassThrough(len(values))
    context, port = system.CreateDefaultContext(), system.get_input_port()
    port.FixValue(context, values)
    np.testing.assert_array_equal(read_vector(port, context), port.Eval(context))
    assert np.shares_memory(read_vector(port, context), read_vector(port, context))
    port.FixValue(context, np.add(values, 1.0))
    np.testing.assert_array_equal(read_vector(port, context), np.add(values, 1.0))
