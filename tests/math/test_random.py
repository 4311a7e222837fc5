import numpy as np

from airrace.math.random import NoiseSequence, make_generator


def test_sources_are_independent_of_each_other():
    a = make_generator(1, "a").standard_normal(1000)
    assert np.array_equal(a, make_generator(1, "a").standard_normal(1000))
    for other in (make_generator(1, "b"), make_generator(2, "a"), make_generator(1, "a", 1)):
        assert abs(np.corrcoef(a, other.standard_normal(1000))[0, 1]) < 0.15


def test_noise_is_a_function_of_its_index():
    forward, backward = NoiseSequence(3, "x", 4), NoiseSequence(3, "x", 4)
    indices = [0, 1, 4095, 4096, 4097, 20000]
    a = [forward[i] for i in indices]
    b = [backward[i] for i in reversed(indices)][::-1]
    np.testing.assert_array_equal(a, b)
    assert len(np.unique(a)) == 4 * len(indices)
    block = np.array([forward[i] for i in range(8000)])
    assert abs(block.mean()) < 0.05 and abs(block.std() - 1) < 0.05
