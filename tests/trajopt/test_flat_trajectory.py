import copy

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from airrace.trajopt.flat_trajectory import FlatTrajectory, flat_outputs, hold
from airrace.trajopt.min_snap.min_snap import solve_min_snap
from airrace.trajopt.reference import REFERENCE_SIZE, as_reference

POINTS = np.array(
    [[0, 0, 5, 0], [10, 2, 6, 1], [15, 12, 4, 2.5], [3, 20, 5, 4], [-9, 4, 6, 6]], float
)
DURATIONS = [1.5, 1.0, 2.0, 1.8]
POLYNOMIAL = solve_min_snap(POINTS, DURATIONS)
TRAJECTORY = FlatTrajectory(POLYNOMIAL)
times = st.floats(0.0, sum(DURATIONS))
few = settings(max_examples=30)


def test_the_layout_covers_the_vector_once():
    indices = np.arange(REFERENCE_SIZE)
    np.testing.assert_array_equal(np.hstack(as_reference(indices)), indices)
    many = np.tile(indices[:, None], 2)
    np.testing.assert_array_equal(np.vstack(as_reference(many)), many)


@few
@given(times)
def test_derivatives_are_the_polynomials(t):
    d = TRAJECTORY.derivatives(t)
    assert d.shape == (5, 4)
    for order in range(5):
        expected = POLYNOMIAL.EvalDerivative(t, order)[:, 0] if order else POLYNOMIAL.value(t)[:, 0]
        np.testing.assert_allclose(d[order], expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(TRAJECTORY.derivatives(t, 2), d[:2])


@few
@given(times)
def test_each_is_the_rate_of_the_one_before(t):
    h = 1e-5
    t = min(max(t, h), TRAJECTORY.duration - h)
    rate = (TRAJECTORY.derivatives(t + h) - TRAJECTORY.derivatives(t - h)) / (2 * h)
    # Snap itself has corners at the breaks, which an interval may straddle.
    np.testing.assert_allclose(rate[:3], TRAJECTORY.derivatives(t)[1:4], atol=1e-3)
    np.testing.assert_allclose(rate[3], TRAJECTORY.derivatives(t)[4], atol=0.05)


@few
@given(st.lists(times, min_size=1, max_size=5))
def test_samples_references_and_derivatives_agree(many):
    samples = TRAJECTORY.sample(many)
    assert samples.shape == (REFERENCE_SIZE, len(many))
    for t, sample in zip(many, samples.T):
        np.testing.assert_allclose(TRAJECTORY.reference(t), sample, rtol=1e-12, atol=1e-12)
        d = TRAJECTORY.derivatives(t)
        np.testing.assert_allclose(flat_outputs(d), sample, rtol=1e-12, atol=1e-12)
        *xyz, yaw, yaw_rate, yaw_acceleration = as_reference(sample)
        np.testing.assert_allclose(xyz, d[:, :3], rtol=1e-12)
        np.testing.assert_allclose([yaw, yaw_rate, yaw_acceleration], d[:3, 3], rtol=1e-12)


@few
@given(st.floats(1e-6, 100.0))
def test_beyond_the_ends(t):
    start, end = TRAJECTORY.derivatives(0.0), TRAJECTORY.derivatives(TRAJECTORY.duration)
    np.testing.assert_allclose(TRAJECTORY.derivatives(-t), start, atol=1e-9)
    np.testing.assert_allclose(TRAJECTORY.derivatives(TRAJECTORY.duration + t), end, atol=1e-9)
    # Whoever follows it past its end hovers there.
    expected = hold(POINTS[-1, :3], POINTS[-1, 3])
    np.testing.assert_allclose(TRAJECTORY.reference(TRAJECTORY.duration + t), expected, atol=1e-9)


@few
@given(st.lists(st.floats(-100, 100), min_size=4, max_size=4), st.floats(-1.0, 10.0))
def test_resting(pose, t):
    resting = FlatTrajectory.resting(pose)
    assert 0 < resting.duration <= 1e-3
    np.testing.assert_array_equal(resting.reference(t), hold(pose[:3], pose[3]))
    np.testing.assert_array_equal(resting.derivatives(t)[1:], 0.0)


def test_a_copy_is_the_thing_itself():
    assert copy.deepcopy(TRAJECTORY) is TRAJECTORY and copy.copy(TRAJECTORY) is TRAJECTORY
    with pytest.raises(AttributeError):
        TRAJECTORY.breaks.append(1.0)
