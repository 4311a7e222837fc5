"""The state filter: no lag, less noise, and a gain that is the optimal one."""

import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator

from airrace.systems import state_estimate as se
from airrace.systems import state_filter
from airrace.systems.state_filter import StateFilter, kalman_gain
from airrace.trajopt.flat_trajectory import ACCELERATION, hold

STATE_RATE, RATE = 200.0, 500.0
few = settings(max_examples=30)
ACC = np.array([1.0, -2.0, 0.5])


def truth(time, acceleration=ACC):
    """Returns (14,) at a time, of a constant acceleration."""
    estimate = np.zeros(se.SIZE)
    estimate[se.TIME] = time
    estimate[se.QUATERNION] = np.cos(time), np.sin(time), 0, 0
    estimate[se.ANGULAR_VELOCITY] = 2.0, time, -1.0
    estimate[se.POSITION] = [1.0 + 5.0 * time, 2.0, 3.0 - time] + time**2 / 2 * acceleration
    estimate[se.VELOCITY] = [5.0, 0, -1] + time * acceleration
    return estimate


class Bench:
    """A StateFilter fed with held estimates, as in the race."""

    def __init__(self, state_rate=STATE_RATE, rate=RATE, acceleration=ACC):
        self.filter = StateFilter(state_rate=state_rate, rate=rate)
        self.simulator = Simulator(self.filter)
        self.context = self.simulator.get_mutable_context()
        self.fix(truth(0.0), acceleration)
        self.simulator.Initialize()

    def fix(self, estimate=None, acceleration=None):
        if estimate is not None:
            self.filter.GetInputPort("state_estimate").FixValue(self.context, estimate)
        if acceleration is not None:
            reference = hold([0, 0, 0], 0.0)
            reference[ACCELERATION] = acceleration
            self.filter.GetInputPort("reference").FixValue(self.context, reference)

    def at(self, time):
        self.simulator.AdvanceTo(time)
        return self.filter.GetOutputPort("filtered_estimate").Eval(self.context)

    def run(self, seconds, period=1 / STATE_RATE, noise=lambda: 0.0, acceleration=ACC, look=0.9):
        """Feeds it; returns looks between two estimates, less the truth then."""
        errors = []
        for k in range(1, round(seconds / period)):
            self.at(k * period)
            self.fix(truth(k * period, acceleration) + noise())
            time = (k + look) * period
            errors.append(self.at(time) - truth(time, acceleration))
        return np.array(errors)


def noise_like_the_races(seed, position=0.005, velocity=0.3):
    rng = np.random.default_rng(seed)

    def noise():
        result = np.zeros(se.SIZE)
        result[se.POSITION] = position * rng.normal(size=3)
        result[se.VELOCITY] = velocity * rng.normal(size=3)
        return result

    return noise


@pytest.mark.parametrize(
    "period, look", [(1 / 200, 0.9), (1 / 200, 0.5), (1 / 100, 0.99), (0.03, 0.7)])
def test_a_constant_acceleration_is_tracked_without_lag(period, look):
    errors = Bench().run(1.0, period, look=look)
    np.testing.assert_allclose(errors[:, se.POSITION], 0.0, atol=1e-9)
    np.testing.assert_allclose(errors[:, se.VELOCITY], 0.0, atol=1e-9)


def test_it_starts_at_the_first_estimate():
    bench = Bench()
    # Before its first tick, that is all there is.
    before = bench.filter.GetOutputPort("filtered_estimate").Eval(bench.context)
    np.testing.assert_array_equal(before, truth(0.0))
    after = bench.at(0.001)
    np.testing.assert_allclose(after[se.POSITION], truth(0.001)[se.POSITION], atol=1e-12)
    np.testing.assert_allclose(after[se.VELOCITY], truth(0.001)[se.VELOCITY], atol=1e-12)


def test_an_estimate_counts_once():
    """However often it is seen: the filter ticks faster than estimates come."""
    noise = np.zeros(se.SIZE)
    noise[se.POSITION], noise[se.VELOCITY] = 1.0, -1.0
    slow, fast = Bench(rate=200.0), Bench(rate=2000.0)
    for bench in (slow, fast):
        bench.at(0.005)
        bench.fix(truth(0.005) + noise)
    # Between two estimates, only the prediction goes on.
    once = fast.at(0.00575).copy()
    moved = fast.at(0.00985) - once
    expected = once[se.VELOCITY] * 0.0041 + ACC * 0.0041**2 / 2
    np.testing.assert_allclose(moved[se.VELOCITY], 0.0041 * ACC, atol=1e-12)
    np.testing.assert_allclose(moved[se.POSITION], expected, atol=1e-12)
    np.testing.assert_allclose(
        slow.at(0.00985)[se.POSITION], fast.at(0.00985)[se.POSITION], atol=1e-12)


def test_an_error_is_corrected_by_the_gain():
    bench = Bench()
    bench.at(0.005)
    error = np.array([0.02, -0.5])
    noise = np.zeros(se.SIZE)
    noise[se.POSITION], noise[se.VELOCITY] = error
    bench.fix(truth(0.005) + noise)
    bench.at(0.0081)
    now = bench.at(0.0081) - truth(0.0081)
    expected = np.array([[1, 0.0031], [0, 1]]) @ kalman_gain(1 / STATE_RATE) @ error
    np.testing.assert_allclose(now[se.POSITION], expected[0], atol=1e-9)
    np.testing.assert_allclose(now[se.VELOCITY], expected[1], atol=1e-9)


def test_attitude_and_angular_velocity_pass_through():
    bench = Bench()
    noise = noise_like_the_races(0)
    for k in range(1, 50):
        bench.at(k / STATE_RATE)
        estimate = truth(k / STATE_RATE) + noise()
        bench.fix(estimate)
        out = bench.at((k + 0.9) / STATE_RATE)
        for part in (slice(0, 1), se.QUATERNION, se.ANGULAR_VELOCITY):
            np.testing.assert_array_equal(out[part], estimate[part])


def steady_covariance(dt, look):
    """Returns the error's covariance a time look after an estimate, (2, 2).

    Without process noise, e' = (I - K) A e - K v, by Lyapunov's equation.
    """
    K, A = kalman_gain(dt), np.array([[1, dt], [0, 1]])
    F, R = (np.eye(2) - K) @ A, np.diag([0.005**2, 0.3**2])
    P = np.zeros((2, 2))
    for _ in range(5000):
        P = F @ P @ F.T + K @ R @ K.T
    ahead = np.array([[1, look], [0, 1]])
    return ahead @ P @ ahead.T


def test_noise_is_reduced_as_much_as_theory_says():
    errors = Bench().run(40.0, noise=noise_like_the_races(1))[200:]
    expected = np.sqrt(np.diag(steady_covariance(1 / STATE_RATE, 0.9 / STATE_RATE)))
    assert errors[:, se.POSITION].std() == pytest.approx(expected[0], rel=0.1)
    assert errors[:, se.VELOCITY].std() == pytest.approx(expected[1], rel=0.1)
    # Which is less than half of the noise on the position, and an eighth of that on the velocity.
    assert errors[:, se.POSITION].std() < 0.005 / 2
    assert errors[:, se.VELOCITY].std() < 0.3 / 8
    np.testing.assert_allclose(errors.mean(axis=0)[se.POSITION], 0.0, atol=1e-3)
    np.testing.assert_allclose(errors.mean(axis=0)[se.VELOCITY], 0.0, atol=1e-2)


def test_what_the_reference_leaves_out_costs_little():
    """A steady acceleration that nobody planned: wind, or drag."""
    errors = Bench(acceleration=[0, 0, 0]).run(20.0, acceleration=ACC)[-1]
    assert np.abs(errors[se.POSITION]).max() < 0.02
    assert np.abs(errors[se.VELOCITY]).max() < 0.25


@functools.cache
def covariances(dt):
    A = np.array([[1, dt], [0, 1]])
    # The integral of exp(F t) [0, 1]' [0, 1] exp(F t)' from 0 to dt.
    nodes, weights = np.polynomial.legendre.leggauss(4)
    Q = sum(
        dt / 2 * w * np.outer([t, 1.0], [t, 1.0])
        for t, w in zip(dt / 2 * (1 + nodes), weights)) * state_filter._ACCELERATION_NOISE**2
    R = np.diag([state_filter._POSITION_SIGMA**2, state_filter._VELOCITY_SIGMA**2])
    return A, Q, R


@few
@given(st.floats(1e-4, 10.0))
def test_the_gain_is_stable_and_shrinks_errors(dt):
    A, _, _ = covariances(dt)
    F = (np.eye(2) - kalman_gain(dt)) @ A
    assert np.abs(np.linalg.eigvals(F)).max() < 1.0
    # It corrects towards the measurement and not past it.
    assert np.all(np.linalg.eigvals(kalman_gain(dt)).real > 0)
    assert np.all(np.linalg.eigvals(kalman_gain(dt)).real < 1)


@pytest.mark.parametrize("dt", [0.001, 1 / 200, 1 / 30, 0.1, 0.2])
def test_the_gain_is_the_limit_of_the_recursion(dt):
    A, Q, R = covariances(dt)
    P = np.eye(2)
    for _ in range(int(200 + 10 / dt)):
        P = A @ P @ A.T + Q
        K = P @ np.linalg.inv(P + R)
        P = (np.eye(2) - K) @ P
    np.testing.assert_allclose(kalman_gain(dt), K, rtol=1e-5, atol=1e-9)


def test_sizes_and_feedthrough():
    ours = StateFilter(state_rate=STATE_RATE, rate=RATE)
    assert ours.GetOutputPort("filtered_estimate").size() == se.SIZE
    assert ours.HasAnyDirectFeedthrough()  # attitude must not wait for a tick
