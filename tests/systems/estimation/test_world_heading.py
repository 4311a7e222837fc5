import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from airrace.math.quaternion import quaternion_product
from airrace.systems.estimation import kalman_update as ku
from airrace.systems.estimation import world_heading as wh
from airrace.systems.estimation.navigation import Navigation, as_navigation
from tests.systems.estimation.motions import CAMERA
from tests.systems.estimation.test_kalman_update import draw, look

seeds = st.integers(0, 1000)


def turned_about_the_vertical(state, gates, angle):
    """Returns drone and gates as they are if the world is turned."""
    c, s = np.cos(angle), np.sin(angle)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    half = np.array([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)])
    drone = Navigation(
        state.time,
        quaternion_product(half, state.quaternion),
        R @ state.position,
        R @ state.velocity,
        state.gyro_bias,
        state.accel_bias,
    )
    return drone, np.column_stack([gates[:, :3] @ R.T, gates[:, 3] + angle, gates[:, 4]])


def information(belief):
    """Returns what a belief says about the heading of the world: n^T P^-1 n."""
    n = wh.turn_of_the_world(as_navigation(belief.navigation), belief.gates)
    return n @ np.linalg.solve(belief.covariance, n)


@given(seeds)
def test_the_direction_is_that_of_a_turn_of_the_world(seed):
    belief = draw(np.random.default_rng(seed))
    state, gates = as_navigation(belief.navigation), belief.gates
    drone, moved = turned_about_the_vertical(state, gates, 1e-6)
    errors = np.concatenate([ku.error_between(drone, state), (moved - gates).ravel()])
    np.testing.assert_allclose(errors / 1e-6, wh.turn_of_the_world(state, gates), atol=1e-4)


@given(seeds)
def test_a_covariance_is_carried_over_as_a_turn_of_the_world_is(seed):
    rng = np.random.default_rng(seed)
    a, b = draw(rng), draw(rng)
    before, after = (
        wh.turn_of_the_world(as_navigation(each.navigation), each.gates) for each in (a, b)
    )
    w, P = ku.body_axes(a)[2], a.covariance
    G = np.eye(len(P))
    G[:, :3] += np.outer(after - before, w)
    np.testing.assert_allclose(G @ before, after, atol=1e-12)
    carried = wh.carried_covariance(P, after - before, w)
    np.testing.assert_allclose(carried, G @ P @ G.T, atol=1e-12)


@given(seeds, st.integers(1, 6))
def test_pictures_tell_nothing_about_the_heading_of_the_world(seed, iterations):
    rng = np.random.default_rng(seed)
    belief = draw(rng)
    known = information(belief)
    for gate, ids in ((0, (0,)), (1, (0, 2)), (0, (2,))):
        belief, fit = ku.updated(belief, look(rng, gate, *ids), CAMERA, 1.0, iterations)
        assert np.isfinite(fit.squared)
    np.testing.assert_allclose(information(belief), known, rtol=1e-6)
    np.testing.assert_allclose(
        information(ku.with_spacing(belief, 0, 10.0, 0.005)), known, rtol=1e-6
    )
