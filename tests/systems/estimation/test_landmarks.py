import dataclasses as dc

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix

from airrace.math.quaternion import exp_quaternion, rotation_matrix
from airrace.systems.estimation import kalman_update as ku
from airrace.systems.estimation import landmarks as lm
from airrace.systems.estimation.alignment import Rest, aligned
from airrace.systems.estimation.gate_projection import predicted_corners
from airrace.systems.estimation.navigation import Navigation, as_navigation, navigation_vector
from airrace.systems.perception.marker_pose import locate
from airrace.vehicle import GRAVITY
from tests.systems.estimation.motions import CAMERA, INFO, NOISE, drone_covariance, navigation


def see(gate, *ids, rng, sigma=0.05, turn=(0.0, 0.0, 0.0)):
    """Returns the Detections of markers of a gate, from a drone that is turned."""
    state = as_navigation(navigation(turn))
    corners = [
        predicted_corners(state, np.array(gate), id, CAMERA)[0] + sigma * rng.standard_normal(8)
        for id in ids
    ]
    return [locate(id, c.reshape(4, 2), 0.01 * np.eye(8), INFO) for id, c in zip(ids, corners)]


def belief():
    return ku.Belief(navigation(), np.zeros((0, 5)), drone_covariance(theta=1e-3, p=0.01))


def twist(belief):
    """Returns the angle about the vertical of a drone's attitude, whatever its tilt (rad)."""
    w, _, _, z = as_navigation(belief.navigation).quaternion
    return 2.0 * np.arctan2(z, w)


# Markers, distances (m), and seeds. Of three hundred seeds each, these are some in which one of
# the two poses led a fit so far astray that it came back with another heading, and fitted better.
MIRRORED = [
    ((0, 2), 8.0, 14.0, (140,)),
    ((1, 3), 14.0, 25.0, (271, 281)),
    ((0,), 8.0, 14.0, (157,)),
]


@pytest.mark.parametrize("heading", [-0.6, -0.2, 0.0, 0.3, 0.6])
@pytest.mark.parametrize("ids", [(0,), (0, 2)])
def test_a_gate_that_is_near_enters_where_it_is(heading, ids):
    for seed in range(5):
        rng, gate = np.random.default_rng(seed), [14.0, 3.0, 6.25, heading, 10.0]
        after = lm.new_gate(belief(), see(gate, *ids, rng=rng), CAMERA)
        if after is None:
            continue
        off = after.gates[0] - gate
        P = after.covariance[15:, 15:]
        assert off @ np.linalg.solve(P, off) < 25.0  # of five numbers, chi-square
        assert abs(off[3]) < 0.5
        assert np.linalg.eigvalsh(after.covariance).min() > 0.0
    assert after is not None or len(ids) == 1


def test_a_gate_far_away_enters_with_the_right_heading_or_waits():
    errors = []  # standard deviations of the heading
    for seed in range(40):
        rng = np.random.default_rng(seed)
        x, y, heading = rng.uniform([32.0, -10.0, -0.9], [45.0, 10.0, 0.9])
        after = lm.new_gate(belief(), see([x, y, 6.25, heading, 10.0], 0, rng=rng), CAMERA)
        if after is not None:
            errors.append((after.gates[0, 3] - heading) / np.sqrt(after.covariance[18, 18]))
    assert np.abs(errors).max() < 4.0
    assert 20 < len(errors) < 40


def test_a_wrong_pose_of_the_two_is_found_out():
    """The detector's pose is only where the fit starts."""
    rng, gate = np.random.default_rng(0), [12.0, 3.0, 6.25, 0.5, 10.0]
    (marker,) = see(gate, 0, rng=rng)
    sight = marker.X_CM.translation() / np.linalg.norm(marker.X_CM.translation())
    normal = marker.X_CM.rotation().col(2)
    mirrored = 2 * (normal @ sight) * sight - normal
    turn = RotationMatrix.MakeFromOneVector(mirrored, 2)
    other = dc.replace(marker, X_CM=RigidTransform(turn, marker.X_CM.translation()))
    after = lm.new_gate(belief(), [other], CAMERA)
    assert after is not None
    assert after.gates[0, 3] == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("ids, near, far, seeds", MIRRORED)
def test_a_gate_tells_nothing_of_the_heading(ids, near, far, seeds):
    """On a tilted pad the heading is known and the tilt is not, whatever the first sight says."""
    for seed in seeds:
        rng = np.random.default_rng(seed)
        turn = np.array([*rng.uniform(-0.16, 0.16, 2), 0.0])
        up = rotation_matrix(exp_quaternion(turn))[2]
        force = GRAVITY * up + rng.normal(scale=NOISE.accel_turn_on, size=3)
        q, *biases, P = aligned(Rest(500, 1.0, np.zeros(3), force), 0.0, NOISE)
        state = Navigation(1.0, q, np.array([0.0, 0.0, 5.0]), np.zeros(3), *biases)
        before = ku.Belief(navigation_vector(state), np.zeros((0, 5)), P)
        x, y, heading = rng.uniform([near, -3.0, -0.8], [far, 3.0, 0.8])
        gate = [x, y, 6.25, heading, 10.0]
        after = lm.new_gate(before, see(gate, *ids, rng=rng, turn=turn), CAMERA)
        assert after is not None
        assert abs(twist(after) - twist(before)) < np.deg2rad(0.1)


def test_several_measurements_have_to_agree():
    gate = np.array([10.0, 0.0, 6.25, 0.0, 10.0])
    candidate = None
    for k in range(3):
        assert candidate is None or not lm.is_confirmed(candidate)
        candidate = lm.agreeing(candidate, 0.1 * k, gate + 0.1 * k)
    assert lm.is_confirmed(candidate)
    assert lm.agreeing(candidate, 0.3, gate + [5, 0, 0, 0, 0]).measurements == 1
    assert lm.agreeing(candidate, 9.0, gate).measurements == 1
