import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.math.quaternion import rotation_matrix
from airrace.systems.estimation import kalman_update as ku
from airrace.systems.estimation.error_state import corrected
from airrace.systems.estimation.gate_projection import predicted_corners
from airrace.systems.estimation.navigation import as_navigation, navigation_vector
from airrace.systems.estimation.world_heading import carried_covariance, turn_of_the_world
from tests.systems.estimation.motions import CAMERA, drone_covariance, navigation, numerical

GATES = np.array([[20.0, 1.0, 6.25, 0.1, 10.0], [25.0, -8.0, 6.25, -0.6, 10.0]])
SIGMAS = np.array([0.3, 0.3, 0.2, 0.05, 0.3])


def draw(rng, scale=1.0):
    """Returns a belief with errors drawn from its covariance; scale: of standard deviations."""
    P = np.zeros((25, 25))
    P[:15, :15] = drone_covariance()
    P[range(15, 25), range(15, 25)] = np.tile(SIGMAS, 2) ** 2
    P *= scale**2
    error = np.sqrt(np.diag(P)) * rng.standard_normal(25)
    state = corrected(as_navigation(navigation()), -error)
    gates = GATES - error[15:].reshape(2, 5)
    return ku.Belief(navigation_vector(state), gates, P)


def look(rng, gate, *ids):
    """Returns what a camera sees of a gate's markers, with noise."""
    truth = as_navigation(navigation())
    looks = [predicted_corners(truth, GATES[gate], id, CAMERA) for id in ids]
    scales = np.array([max(1.0, depth / ku.SHARP_RANGE) for *_, depth in looks])
    noise = ku.CORNER_SIGMA * scales[:, None] * rng.standard_normal((len(ids), 8))
    pixels = np.array([pixels for pixels, *_ in looks])
    return ku.GateMeasurement(gate, np.array(ids), pixels + noise, np.zeros(len(ids)))


def errors(belief):
    drone = ku.error_between(as_navigation(navigation()), as_navigation(belief.navigation))
    return np.concatenate([drone, (GATES - belief.gates).ravel()])


@pytest.mark.parametrize(("iterations", "scale"), [(1, 0.1), (5, 1.0)])
def test_errors_after_updates_are_as_great_as_they_should_be(iterations, scale):
    """One iteration is enough where little is uncertain."""
    rng, total, count = np.random.default_rng(1), 0.0, 200
    innovations = []
    for _ in range(count):
        belief = draw(rng, scale)
        for gate, id in ((0, 0), (0, 2), (1, 0), (0, 0)):
            belief, fit = ku.updated(belief, look(rng, gate, id), CAMERA, 1.0, iterations)
            innovations.append(fit.squared)
        off = errors(belief)
        total += off @ np.linalg.solve(belief.covariance, off) / len(off)
    assert 0.9 < total / count < 1.15
    assert 7.0 < np.mean(innovations) < 10.0  # eight coordinates


@given(st.integers(0, 50))
def test_the_covariance_shrinks_and_stays_one(seed):
    rng = np.random.default_rng(seed)
    before = draw(rng)
    after, _ = ku.updated(before, look(rng, 1, 0, 2), CAMERA, 1.0, 3)
    np.testing.assert_array_equal(after.covariance, after.covariance.T)
    assert np.linalg.eigvalsh(after.covariance).min() > 0.0
    # But for what a turn of the world, which is as uncertain as before, does at another place.
    n_before, n_after = (
        turn_of_the_world(as_navigation(each.navigation), each.gates) for each in (before, after)
    )
    w = ku.body_axes(before)[2]
    P = carried_covariance(before.covariance, n_after - n_before, w)
    assert np.linalg.eigvalsh(P - after.covariance).min() > -1e-10


def test_a_doubtful_sight_counts_less():
    rng = np.random.default_rng(0)
    before, sight = draw(rng), look(rng, 0, 0)
    full, _ = ku.updated(before, sight, CAMERA, 1.0, 1)
    less, _ = ku.updated(before, sight, CAMERA, 100.0, 1)
    assert np.all(np.diag(less.covariance) >= np.diag(full.covariance))


def test_nothing_behind_the_camera_changes_anything():
    rng = np.random.default_rng(0)
    belief, sight = draw(rng), look(rng, 0, 0)
    behind = ku.Belief(belief.navigation, belief.gates * [-1, 1, 1, 1, 1], belief.covariance)
    after, fit = ku.updated(behind, sight, CAMERA, 1.0, 3)
    assert fit.squared == np.inf
    np.testing.assert_array_equal(after.covariance, behind.covariance)


def test_a_known_spacing():
    belief, _ = ku.updated(
        draw(np.random.default_rng(3)), look(np.random.default_rng(3), 0, 0, 2), CAMERA, 1.0, 5
    )
    after = ku.with_spacing(belief, 0, 10.0, 0.005)
    assert after.gates[0, 4] == pytest.approx(10.0, abs=0.01)
    assert after.covariance[19, 19] < 0.005**2
    assert np.linalg.eigvalsh(after.covariance).min() > 0.0


def test_a_relative_covariance_is_that_of_what_the_drone_has_before_itself():
    belief, _ = ku.updated(
        draw(np.random.default_rng(3)), look(np.random.default_rng(3), 1, 0), CAMERA, 1.0, 2
    )
    start = as_navigation(belief.navigation)

    def before_the_drone(error):
        """Returns the gate as seen from the drone, in its heading."""
        drone, gates = corrected(start, error), belief.gates + error[15:].reshape(-1, 5)
        turn = -(rotation_matrix(start.quaternion)[2] @ error[:3])  # back
        offset = gates[1, :3] - drone.position
        c, s = np.cos(turn), np.sin(turn)
        x, y = c * offset[0] - s * offset[1], s * offset[0] + c * offset[1]
        return np.array([x, y, offset[2], gates[1, 3] + turn, gates[1, 4]])

    J = numerical(before_the_drone, len(belief.covariance))
    np.testing.assert_allclose(
        ku.relative_covariance(belief, 1), J @ belief.covariance @ J.T, atol=1e-8
    )
    # A turn of the world is nothing to the drone.
    np.testing.assert_allclose(J @ turn_of_the_world(start, belief.gates), 0.0, atol=1e-7)
