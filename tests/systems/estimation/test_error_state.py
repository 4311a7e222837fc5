import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from airrace.systems.estimation import error_state as es
from airrace.systems.estimation.kalman_update import error_between
from airrace.systems.estimation.navigation import as_navigation, carried_to
from tests.systems.estimation.motions import (
    NOISE,
    PERIOD,
    as_history,
    drone_covariance,
    moved_by,
    navigation,
    numerical,
    vectors,
)


@given(vectors, vectors, vectors)
def test_the_transition_is_the_derivative_of_a_step(turn, w, f):
    state = as_navigation(navigation(turn, v=(3.0, -2.0, 1.0)))
    sample = np.array([1.002, *(3.0 * w), *(9.0 * f)])
    after = moved_by(state, sample, PERIOD)

    def error_after(error):
        return error_between(moved_by(es.corrected(state, error), sample, PERIOD), after)

    J = numerical(error_after, es.DRONE)
    # To first order in the step: the gyroscope's bias acts at its end.
    np.testing.assert_allclose(es.transition(state, sample, PERIOD), J, atol=2e-5)


@given(st.integers(0, 100))
def test_the_covariance_stays_one(seed):
    rng = np.random.default_rng(seed)
    samples = [
        np.array([1.0 + PERIOD * k, *rng.normal(0, 2, 3), *rng.normal(0, 9, 3)])
        for k in range(1, 51)
    ]
    A = rng.normal(size=(25, 25))
    P = A @ A.T * 1e-4
    vector, after = es.propagate(navigation(), P, as_history(samples), 1.0999, NOISE)
    np.testing.assert_array_equal(after, after.T)
    assert np.linalg.eigvalsh(after).min() > 0.0
    np.testing.assert_array_equal(after[15:, 15:], P[15:, 15:])  # gates stand still
    np.testing.assert_array_equal(vector, carried_to(navigation(), as_history(samples), 1.0999))


def test_errors_grow_as_the_covariance_says():
    """Monte Carlo: squared errors over variances have the mean that they should."""
    rng, count, steps = np.random.default_rng(0), 300, 250
    clean = [
        np.array([1.0 + PERIOD * k, 1.0, 0.5 * np.sin(0.05 * k), 2.0, 2.0, 1.0, 9.0])
        for k in range(1, steps + 1)
    ]
    truth = as_navigation(carried_to(navigation(), as_history(clean), 1.0 + PERIOD * steps))
    start = drone_covariance(theta=0.02, p=0.01, v=0.02, gyro=2e-3, accel=0.05)
    total, sigmas = 0.0, np.sqrt(np.diag(start))
    for _ in range(count):
        error = sigmas * rng.standard_normal(es.DRONE)
        guess = es.corrected(as_navigation(navigation()), -error)
        noisy = [
            sample
            + np.concatenate(
                [
                    [0.0],
                    NOISE.gyro / np.sqrt(PERIOD) * rng.standard_normal(3),
                    NOISE.accel / np.sqrt(PERIOD) * rng.standard_normal(3),
                ]
            )
            for sample in clean
        ]
        vector, P = es.propagate(
            np.concatenate([[1.0], *guess[1:]]),
            start,
            as_history(noisy),
            1.0 + PERIOD * steps,
            NOISE._replace(gyro_walk=0.0, accel_walk=0.0),
        )
        off = error_between(truth, as_navigation(vector))
        total += off @ np.linalg.solve(P, off) / es.DRONE
    assert 0.9 < total / count < 1.1
