"""Legs: from any motion, through the waypoints, to rest."""

import contextlib
from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from airrace.track import load_track
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.feasibility import peaks, sample_times
from airrace.trajopt.min_snap import time_allocation
from airrace.trajopt.min_snap.leg import plan_leg, trapezoid_durations

LIMITS = dict(max_speed=8.0, max_acceleration=6.0)
few = settings(max_examples=25)
seeds = st.integers(0, 10**6)


def state(pose=(0.0, 0.0, 5.0, 0.0), velocity=(0.0, 0.0, 0.0, 0.0)):
    result = np.zeros((5, 4))
    result[:2] = pose, velocity
    return result


def random_waypoints(rng):
    m = rng.integers(1, 5)
    steps = rng.uniform(-40, 40, (m, 2))
    return np.column_stack([np.cumsum(steps, axis=0), rng.uniform(2, 9, m), rng.uniform(-9, 9, m)])


def dense(leg):
    return leg.sample(np.linspace(0.0, leg.duration, int(500 * leg.duration) + 2))


def assert_leads(leg, start, waypoints):
    """Continuous with the start, through all waypoints, at rest at the last."""
    first = leg.derivatives(0.0)
    np.testing.assert_allclose(first[:4, :3], start[:4, :3], atol=1e-9)
    np.testing.assert_allclose(first[:2, 3], start[:2, 3], atol=1e-9)
    waypoints = np.array(waypoints)
    poses = np.array([leg.derivatives(t)[0] for t in leg.breaks[1:]])
    np.testing.assert_allclose(poses[:, :3], waypoints[:, :3], atol=1e-8)
    np.testing.assert_allclose(np.exp(1j * poses[:, 3]), np.exp(1j * waypoints[:, 3]), atol=1e-8)
    np.testing.assert_allclose(leg.derivatives(leg.duration)[1:4], 0.0, atol=1e-8)
    yaw = np.array([leg.derivatives(t)[0, 3] for t in leg.breaks])
    assert np.abs(np.diff(yaw)).max() <= np.pi + 1e-9
    for t in leg.breaks[1:-1]:
        np.testing.assert_allclose(leg.derivatives(t - 1e-9), leg.derivatives(t + 1e-9), atol=1e-5)


@few
@given(seeds)
def test_from_rest(seed):
    rng = np.random.default_rng(seed)
    start = state([*rng.uniform(-9, 9, 2), 5.0, rng.uniform(-9, 9)])
    waypoints = random_waypoints(rng)
    leg = plan_leg(start, waypoints, **LIMITS)
    assert_leads(leg, start, waypoints)
    speed, acceleration = peaks(dense(leg))
    assert speed <= 8.0 * (1 + 1e-6) and acceleration <= 6.0 * (1 + 1e-6)


@few
@given(seeds)
def test_from_motion(seed):
    rng = np.random.default_rng(seed)
    velocity = np.append(rng.uniform(-4, 4, 2), [rng.uniform(-0.5, 0.5), rng.uniform(-1, 1)])
    start, waypoints = state(velocity=velocity), random_waypoints(rng)
    leg = plan_leg(start, waypoints, **LIMITS)
    assert_leads(leg, start, waypoints)
    speed, acceleration = peaks(dense(leg))
    assert speed <= 16.0 * (1 + 1e-6) and acceleration <= 12.0 * (1 + 1e-6)


@few
@given(seeds)
def test_a_slow_start_keeps_the_limits(seed):
    rng = np.random.default_rng(seed)
    velocity = np.append(rng.uniform(-0.7, 0.7, 2), [0.0, rng.uniform(-1, 1)])
    leg = plan_leg(state(velocity=velocity), random_waypoints(rng), **LIMITS)
    speed, acceleration = peaks(dense(leg))
    assert speed <= 8.0 * (1 + 1e-6) and acceleration <= 6.0 * (1 + 1e-6)


@pytest.mark.slow
@given(seeds)
def test_a_leg_is_planned_with_few_trials(seed):
    """Control waits for it; one that cannot be flown must not take long, either."""
    rng = np.random.default_rng(seed)
    start = state(velocity=(rng.uniform(2, 8), 0, 0, 0))
    start[2:4] = rng.normal(scale=2.0, size=(2, 4))
    waypoints = random_waypoints(rng)
    with (
        mock.patch.object(
            time_allocation, "slowdown_factor", side_effect=time_allocation.slowdown_factor
        ) as trials,
        contextlib.suppress(TrajectoryOptimizationError),
    ):
        plan_leg(start, waypoints, **LIMITS)
    assert 0 < trials.call_count < 800  # of a tenth of a millisecond


def test_a_start_that_is_too_fast_exceeds_them_but_gets_there():
    start = state(velocity=(8.0, 0, 0, 0))
    leg = plan_leg(start, [[3.0, 0, 5, 0]], **LIMITS)
    assert_leads(leg, start, [[3.0, 0, 5, 0]])
    assert 6.0 < peaks(dense(leg))[1] <= 12.0


def test_from_the_middle_of_another_leg():
    """As the explorer does when it finds a gate on its way."""
    waypoints = [[20.0, 0, 6, 0], [35, 10, 6, 0.8], [40, 30, 6, 1.6]]
    first = plan_leg(state(), waypoints[:2], **LIMITS)
    for t in np.linspace(0.5, 0.95 * first.breaks[1], 5):
        start = first.derivatives(t)
        leg = plan_leg(start, waypoints, **LIMITS)
        assert_leads(leg, start, waypoints)
        # Close before a gate it is too late to keep the limits in the turn behind.
        excess = 1.0 if t < 0.9 * first.breaks[1] else 2.0
        speed, acceleration = peaks(dense(leg))
        assert speed <= 8.0 * excess * (1 + 1e-6) and acceleration <= 6.0 * excess * (1 + 1e-6)


def test_through_the_reference_gates():
    track = load_track("student-airrace")
    gates = [[*gate.p_WG, gate.heading] for gate in track.gates]
    leg = plan_leg(state(), gates, **LIMITS)
    assert_leads(leg, state(), gates)
    assert peaks(dense(leg))[0] <= 8.0 * (1 + 1e-6)
    # Yaw has made a turn, not come back to 45 degrees.
    assert leg.derivatives(leg.duration)[0, 3] == pytest.approx(np.pi / 4 + 2 * np.pi)


@few
@given(st.floats(-20, 20), st.floats(-20, 20))
def test_a_turn_on_the_spot(yaw, goal):
    leg = plan_leg(state((3.0, 4, 5, yaw)), [[3, 4, 5, goal]], **LIMITS)
    samples = dense(leg)
    assert np.abs(samples[:3] - np.array([[3.0], [4.0], [5.0]])).max() < 1e-9
    turned = leg.derivatives(leg.duration)[0, 3] - leg.derivatives(0.0)[0, 3]
    assert abs(turned) <= np.pi + 1e-9
    assert np.cos(yaw + turned - goal) == pytest.approx(1.0, abs=1e-6)
    # Not faster than the drag torques of its rotors can turn a multirotor.
    assert np.abs(samples[17]).max() < 2.6


def test_half_a_turn():
    leg = plan_leg(state(), [[0.0, 0, 5, np.pi]], **LIMITS)
    assert abs(leg.derivatives(leg.duration)[0, 3]) == pytest.approx(np.pi)
    assert leg.duration > 1.5


@pytest.mark.parametrize("offset", [0.0, 1e-6, 5e-4])
@pytest.mark.parametrize("turns", [0, -1, 3])
@pytest.mark.parametrize("x", [0.0, 5000.0])
def test_staying_where_it_is(offset, turns, x):
    # What ends a leg is at rest but for rounding.
    start = state((x, 0, 5, 0), 4 * [1e-12])
    leg = plan_leg(start, [[x + offset, 0, 5, 2 * np.pi * turns]], **LIMITS)
    np.testing.assert_allclose(leg.derivatives(leg.duration), start, atol=1e-3)
    nowhere = plan_leg(state(), np.zeros((0, 4)), **LIMITS)
    np.testing.assert_array_equal(nowhere.derivatives(0), state())


def test_a_centimetre_is_flown_even_far_from_the_origin():
    leg = plan_leg(state((5000.0, 0, 5, 0)), [[5000.01, 0, 5, 0]], **LIMITS)
    assert leg.derivatives(leg.duration)[0, 0] == pytest.approx(5000.01, abs=1e-6)


@pytest.mark.parametrize("i", range(3))
def test_a_waypoint_twice_is_one(i):
    waypoints = [[0.0, 0, 5, 0], [10, 0, 5, 0], [20, 5, 6, 1]]
    once = plan_leg(state(), waypoints[1:], **LIMITS)
    twice = plan_leg(state(), [*waypoints[:i], waypoints[i], *waypoints[i:]], **LIMITS)
    np.testing.assert_allclose(twice.breaks, once.breaks)
    assert_leads(twice, state(), waypoints[1:])


@pytest.mark.parametrize("ahead", [0.01, 0.1, 1.0])
def test_braking_past_a_near_waypoint_and_back(ahead):
    start = state(velocity=(5.0, 0, 0, 0))
    leg = plan_leg(start, [[ahead, 0, 5, 0]], **LIMITS)
    assert_leads(leg, start, [[ahead, 0, 5, 0]])
    assert peaks(dense(leg))[1] <= 12.0 * (1 + 1e-6)


def test_no_leg_leads_from_motion_to_rest_on_the_spot():
    with pytest.raises(TrajectoryOptimizationError):
        plan_leg(state(velocity=(5.0, 0, 0, 0)), [[0.0, 0, 5, 0]], **LIMITS)


def test_no_leg_from_far_too_fast():
    with pytest.raises(TrajectoryOptimizationError):
        plan_leg(state(velocity=(60.0, 0, 0, 0)), [[1.0, 0, 5, 0]], **LIMITS)


@few
@given(seeds)
def test_a_leg_does_not_depend_on_where_it_is(seed):
    rng = np.random.default_rng(seed)
    waypoints, angle, shift = random_waypoints(rng), rng.uniform(-3, 3), rng.uniform(-100, 100, 2)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

    def there(poses):
        return np.column_stack([poses[:, :2] @ turn.T + shift, poses[:, 2], poses[:, 3] + angle])

    start = state(velocity=[*rng.uniform(-0.5, 0.5, 2), 0.0, 0.0])
    moved = start.copy()
    moved[:1] = there(start[:1])
    moved[1, :2] = turn @ start[1, :2]
    here, leg = plan_leg(start, waypoints, **LIMITS), plan_leg(moved, there(waypoints), **LIMITS)
    np.testing.assert_allclose(leg.breaks, here.breaks, rtol=1e-5)
    at = here.duration * np.linspace(0, 1, 20)
    expected = there(np.array([here.derivatives(t)[0] for t in at]))
    flown = np.array([leg.derivatives(t)[0] for t in at])
    np.testing.assert_allclose(flown, expected, atol=1e-3)


@few
@given(st.floats(0.5, 200.0), st.floats(1.0, 20.0), st.floats(0.5, 10.0))
def test_trapezoid_on_one_line(distance, cruise, acceleration):
    ramp = cruise**2 / acceleration  # to full speed and to rest again
    expected = 2 * np.sqrt(distance / acceleration)
    if distance > ramp:
        expected = 2 * cruise / acceleration + (distance - ramp) / cruise
    points = np.array([[0, 0, 0], [0, distance, 0]])
    durations = trapezoid_durations(points, 0.0, cruise, acceleration)
    # The first and last bits of the way take longest and are sampled coarsely.
    assert durations == pytest.approx([max(expected, 0.2)], rel=0.1)
    halves = trapezoid_durations(
        np.array([[0, 0, 0], [0, distance / 2, 0], [0, distance, 0]]), 0.0, cruise, acceleration
    )
    assert halves.sum() == pytest.approx(max(durations[0], 0.4), rel=1e-6)
    assert halves[0] == pytest.approx(halves[1])


def test_trapezoid_of_points_that_coincide_and_of_a_fast_start():
    assert trapezoid_durations(np.zeros((3, 3)), 0.0, 5.0, 2.0).tolist() == [0.2, 0.2]
    points = np.array([[0.0, 0, 0], [50, 0, 0]])
    slow, fast = (trapezoid_durations(points, v, 8.0, 3.0)[0] for v in (0, 8))
    assert 50 / 8 < fast < slow


def test_sample_times_of_a_leg_end_with_it():
    leg = plan_leg(state(), [[10.0, 0, 5, 0]], **LIMITS)
    assert sample_times(leg)[-1] == leg.duration


def test_a_turn_that_is_broken_off_does_not_become_a_spin():
    """A turn on the spot, and then 50 m the other way."""
    turn = plan_leg(state(), [[0.0, 0.0, 5.0, 2.0]], **LIMITS)
    start = turn.derivatives(0.2 * turn.duration)[:5]
    assert np.abs(start[2, 3]) > 0.5
    leg = plan_leg(start, [[-50.0, 0.0, 5.0, np.pi]], **LIMITS)
    yaw = [leg.derivatives(t)[0, 3] for t in np.linspace(0.0, leg.duration, 200)]
    assert np.ptp(yaw) < 1.5 * np.pi
