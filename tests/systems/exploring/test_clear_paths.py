import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from airrace.systems.exploring import clear_paths
from airrace.systems.exploring.exploration import gate_pose
from airrace.trajopt.min_snap.leg import plan_leg
from tests.systems.exploring.test_exploration import mapped

GATE_MAP = mapped({0: 9, 2: 9, 4: 9, 6: 9})  # gates 1 and 2
GATES = GATE_MAP.gates
LIMITS = dict(max_speed=8.0, max_acceleration=6.0)


def fly(*poses):
    start = np.zeros((5, 4))
    start[0] = poses[0]
    return plan_leg(start, np.array(poses[1:], float), **LIMITS)


def straight(y, x=(0.0, 30.0), z=6.0):
    return fly([x[0], y, z, 0.0], [x[1], y, z, 0.0])


@pytest.mark.parametrize(
    "y, clearance, clear",
    [(7.2, 2.1, True), (7.2, 2.3, False), (-12.0, 2.3, True), (5.0, 0.5, False)],
)
def test_a_larger_drone_needs_more_room(y, clearance, clear):
    """Outside of gate 1, whose pylons are at y = 5 and -5."""
    assert clear_paths.is_clear(straight(y), GATE_MAP, clearance) is clear


def test_who_is_too_near_may_go_but_not_come_nearer():
    away, nearer = ([[20.0, 7.0, 6.0, 0.0], [20.0, y, 6.0, 0.0]] for y in (12.0, 6.5))
    assert clear_paths.is_clear(fly(*away), GATE_MAP, 3.0)
    assert not clear_paths.is_clear(fly(*nearer), GATE_MAP, 3.0)


def test_only_the_right_gaps_forward():
    through, back = straight(0.0), straight(0.0, x=(30.0, 0.0))
    assert clear_paths.is_clear(through, GATE_MAP, 2.0, [0])
    assert not clear_paths.is_clear(through, GATE_MAP, 2.0)
    assert not clear_paths.is_clear(through, GATE_MAP, 2.0, [0, 1])
    assert not clear_paths.is_clear(through, GATE_MAP, 2.0, [1])
    assert not clear_paths.is_clear(back, GATE_MAP, 2.0, [0])
    assert not clear_paths.is_clear(back, GATE_MAP, 2.0)
    assert not clear_paths.is_clear(straight(12.0), GATE_MAP, 2.0, [0])


def test_a_gate_of_which_one_board_was_seen_is_a_gap_too():
    assert not clear_paths.is_clear(straight(0.0), mapped({2: 9}), 2.0)
    assert clear_paths.is_clear(straight(0.0), mapped({2: 2}), 2.0)


def test_what_was_flown_does_not_count():
    leg = straight(0.0)
    assert not clear_paths.is_clear(leg, GATE_MAP, 2.0)
    assert clear_paths.is_clear(leg, GATE_MAP, 2.0, after=0.9 * leg.duration)


def test_above_the_tips_is_no_gap_and_near_the_ground_no_way():
    assert clear_paths.is_clear(straight(0.0, z=15.0), GATE_MAP, 2.0)
    dips = fly([0.0, 12.0, 5.0, 0.0], [10.0, 12.0, 0.5, 0.0], [20.0, 12.0, 5.0, 0.0])
    assert not clear_paths.is_clear(dips, GATE_MAP, 2.0)


def test_over_the_top_is_free():
    leg = fly(
        [0.0, 0.0, 5.0, 0.0],
        *clear_paths.route_above_pylons([0.0, 0.0, 5.0, 0.0], np.array([48.0, 12.0, 6.0, 1.0])),
    )
    assert clear_paths.is_clear(leg, GATE_MAP, 2.0)
    np.testing.assert_allclose(leg.derivatives(leg.duration, 1)[0], [48.0, 12.0, 6.0, 1.0])


HEIGHTS = st.one_of(st.floats(2.0, 8.0), st.floats(12.0, 15.0))  # of gates, and above them


@settings(max_examples=40, deadline=None)
@given(st.floats(0.0, 200.0), st.floats(-3.1, 3.1), HEIGHTS, HEIGHTS, st.floats(-3.1, 3.1))
def test_over_the_top_swings_out_nowhere(far, bearing, start_height, goal_height, yaw):
    forward, left = np.array(
        [[np.cos(bearing), np.sin(bearing)], [-np.sin(bearing), np.cos(bearing)]]
    )
    start, goal = [0.0, 0.0, start_height, 0.0], [*far * forward, goal_height, yaw]
    leg = fly(start, *clear_paths.route_above_pylons(start, goal))
    x, y, z = leg.positions(np.linspace(0.0, leg.duration, 500))
    along, aside = forward @ [x, y], left @ [x, y]
    assert z.min() > min(start_height, goal_height) - 0.1
    assert z.max() < clear_paths.ABOVE_PYLONS + 4.5
    assert np.abs(aside).max() < 0.01 and -7.5 < along.min() and along.max() < far + 4.0
    assert np.all(z[(along > 5.0) & (along < far - 5.0)] > clear_paths.PYLON_HEIGHT)
    assert leg.duration < 10.5 + far / 4.0


def test_gate_crossings_are_in_order_with_their_times():
    start = [0.0, 0.0, 6.0, 0.0]
    leg = fly(start, gate_pose(GATES[0]), gate_pose(GATES[1]), gate_pose(GATES[1], 5.0))
    passed = clear_paths.gate_crossings(*clear_paths.positions(leg), GATES)
    assert [(n, forward) for _, n, forward in passed] == [(0, True), (1, True)]
    np.testing.assert_allclose([t for t, *_ in passed], leg.breaks[1:3], atol=1e-2)


def test_a_gate_is_approached_from_the_front_from_anywhere():
    """Some way through gate 2 is free from before, beside, and behind it."""
    gate = GATES[1]
    for pose in (
        gate_pose(gate, -20.0),
        gate_pose(gate, 15.0),
        gate_pose(gate) + [-9.0, 9.0, 0.0, 0.0],
    ):
        routes = clear_paths.routes_through(pose, [gate], approach=8.0, beyond=5.0)
        legs = [fly(pose, *route) for route in routes]
        assert any(clear_paths.is_clear(leg, GATE_MAP, 2.0, [1]) for leg in legs)
        for route in routes:
            np.testing.assert_allclose(route[-1], gate_pose(gate, 5.0))
