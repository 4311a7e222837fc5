import numpy as np

from airrace.math.random import SHORT, NoiseSequence, derive, make_generator, short_name


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


def test_generators_of_a_long_seed_tell_nothing_of_each_other():
    """Each has a seed of its own; those of a short one share it, and a label that all know."""
    long = 2**200 + 1
    a, b = (make_generator(long, name).bit_generator.seed_seq.entropy for name in "ab")
    assert a != b and min(a, b) > 2**128 and derive("s", "x") != derive("t", "x")
    assert make_generator(long, "a", 1).bit_generator.seed_seq.entropy not in (a, b)
    assert make_generator(5, "a").bit_generator.seed_seq.entropy[0] == 5


def test_a_long_seed_is_known_by_a_short_name():
    long = 2**200 + 2
    assert 0 <= short_name(long) == short_name(long) <= SHORT
    assert [short_name(seed) for seed in (0, 7, SHORT)] == [0, 7, SHORT]
    by_name = NoiseSequence(short_name(long), "x", 3)[5]
    np.testing.assert_array_equal(by_name, NoiseSequence(long, "x", 3)[5])
