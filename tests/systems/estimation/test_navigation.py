import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from airrace.math.quaternion import (
    exp_quaternion,
    quaternion_product,
    rotation_between,
    rotation_matrix,
    turned,
)
from airrace.systems.estimation import navigation as nav
from airrace.vehicle.state import as_state
from tests.systems.estimation.motions import (
    PERIOD,
    as_history,
    moved_by,
    navigation,
    true_sample,
    vectors,
)


@given(vectors, vectors)
def test_products_are_rotations_in_a_row(a, b):
    p, q = exp_quaternion(a), exp_quaternion(b)
    np.testing.assert_allclose(
        rotation_matrix(quaternion_product(p, q)),
        rotation_matrix(p) @ rotation_matrix(q),
        atol=1e-12,
    )
    np.testing.assert_allclose(rotation_between(p, turned(p, b)), b, atol=1e-9)


@given(vectors, vectors, vectors)
def test_a_constant_turn_and_acceleration_are_integrated_exactly(turn, w, a):
    """The velocity to the last digit; the position as a parabola."""
    vector, samples, time = navigation(turn, v=(1.0, 2.0, 3.0)), [], 1.0
    state = nav.as_navigation(vector)
    for _ in range(50):
        time += PERIOD
        R = rotation_matrix(state.quaternion)
        samples.append(true_sample(time, w, a, R))
        state = moved_by(state, samples[-1], PERIOD)
    result = nav.as_navigation(nav.carried_to(vector, as_history(samples), time))
    T = time - 1.0
    np.testing.assert_allclose(result.velocity, [1, 2, 3] + a * T, atol=1e-9)
    np.testing.assert_allclose(
        result.position, [0, 0, 5] + np.array([1, 2, 3]) * T + a * T**2 / 2, atol=1e-9
    )
    turned = rotation_matrix(exp_quaternion(np.array(turn))) @ rotation_matrix(
        exp_quaternion(w * T)
    )
    np.testing.assert_allclose(rotation_matrix(result.quaternion), turned, atol=1e-9)


@given(st.lists(st.floats(1.0, 1.1), min_size=1, max_size=3).map(sorted), vectors)
def test_stops_on_the_way_change_nothing(stops, w):
    samples = [np.array([1.0 + PERIOD * k, *w, 0.1 * k, 0.0, 9.81]) for k in range(1, 60)]
    vector, history = navigation(), as_history(samples)
    direct = nav.carried_to(vector, history, 1.1)
    for stop in stops:
        vector = nav.carried_to(vector, history, stop)
    # Samples are means: a stop within one changes how the turn in it is seen.
    np.testing.assert_allclose(nav.carried_to(vector, history, 1.1), direct, atol=1e-4)


def test_a_lost_sample_is_bridged():
    samples = [np.array([1.0 + PERIOD * k, 0.0, 0.0, 0.5, 0.0, 0.0, 9.81]) for k in range(1, 60)]
    whole = nav.carried_to(navigation(), as_history(samples), 1.1)
    partial = nav.carried_to(navigation(), as_history(samples[:10] + samples[35:]), 1.1)
    np.testing.assert_allclose(partial, whole, atol=1e-9)


def test_only_sound_and_new_samples_are_remembered():
    history = np.full((5, 7), -1.0)
    rows = np.zeros((10, 7))
    rows[:, 0] = -1.0
    rows[0, 0], rows[1, 0], rows[2, 0] = 0.006, 0.004, 0.002
    rows[1, 3] = np.nan
    assert nav.remember(history, rows, np.full(6, 50.0)) == 2
    np.testing.assert_array_equal(history[:3, 0], [0.006, 0.002, -1.0])
    assert nav.remember(history, rows, np.full(6, 50.0)) == 0
    rows[0, 0], rows[0, 5] = 0.008, 50.0  # the end of the range
    assert nav.remember(history, rows, np.full(6, 50.0)) == 0


@given(vectors, vectors)
def test_the_bodys_origin_turns_about_the_sensor(turn, w):
    """The velocities of two points of a rigid body differ by w x r."""
    vector, r = navigation(turn, v=(1.0, 0.0, 0.0)), np.array([0.1, -0.2, 0.3])
    result = np.zeros(14)
    nav.write_state(result, nav.as_navigation(vector), w, r)
    body, R = as_state(result), rotation_matrix(vector[1:5])
    np.testing.assert_allclose(body.position, vector[5:8] - R @ r, atol=1e-12)
    np.testing.assert_allclose(body.velocity + np.cross(R @ w, R @ r), [1, 0, 0], atol=1e-12)
