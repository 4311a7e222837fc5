import dataclasses as dc

import numpy as np
import pytest

from airrace.scenario import ExplorerConfig
from airrace.systems.exploring.exploration import gate_pose
from airrace.systems.exploring.explorer_legs import LegPlanner
from airrace.systems.exploring.explorer_memory import Memory, Situation
from airrace.trajopt.min_snap.leg import plan_leg
from tests.systems.exploring.test_exploration import mapped, situation

CONFIG = ExplorerConfig()
LEGS = LegPlanner(config=CONFIG, clearance=2.0)
LIMITS = dict(max_speed=8.0, max_acceleration=6.0)


def flying(start, goal, time, counts):
    """What is known of a drone some time after it set out from a pose to another."""
    begin = np.zeros((5, 4))
    begin[0] = start
    leg = plan_leg(begin, np.array([goal], float), **LIMITS)
    now = situation(counts, [])
    memory = dc.replace(Memory().flying(leg, 0.0), home=np.array([0.0, 0.0, 5.0, 0.0]))
    return Situation(memory, time, now.detections, mapped(counts), now.estimate)


def test_a_leg_goes_on_from_the_motion_of_the_last():
    now = flying([0, 0, 6, 0], [40, 12, 6, 0], 2.0, {})
    leg = LEGS.plan(now, [[[60.0, 20.0, 6.0, 0.0]]])
    np.testing.assert_allclose(
        leg.derivatives(0.0, 4), now.memory.leg.derivatives(2.0, 4), atol=1e-6
    )
    np.testing.assert_allclose(leg.derivatives(leg.duration, 1)[0], [60, 20, 6, 0], atol=1e-9)


def test_the_first_free_route_is_taken():
    now = flying([0, 0, 6, 0], [1, 0, 6, 0], 9.0, {0: 9, 2: 9})
    blocked, free = [[30.0, 0.0, 6.0, 0.0]], [[30.0, 12.0, 6.0, 0.0]]
    assert LEGS.plan(now, [blocked]) is None
    leg = LEGS.plan(now, [blocked, free])
    np.testing.assert_allclose(leg.derivatives(leg.duration, 1)[0], free[0], atol=1e-9)


def test_gates_are_passed_in_order_at_known_times():
    now = flying([0, 0, 6, 0], [1, 0, 6, 0], 9.0, {0: 9, 2: 9, 4: 9, 6: 9})
    gates = list(now.gate_map.gates)
    leg = LEGS.plan_through(now, gates)
    times = LEGS.passing_times(leg, gates)
    assert 0.0 < times[0] < times[1] < leg.duration
    for gate, time in zip(gates, times):
        np.testing.assert_allclose(leg.derivatives(time, 1)[0, :3], gate.p_WG, atol=0.1)
    np.testing.assert_allclose(
        leg.derivatives(leg.duration, 1)[0, :3],
        gate_pose(gates[-1], CONFIG.passing_distance)[:3],
        atol=1e-6,
    )


def test_a_stop_is_soon_and_before_what_is_in_the_way():
    now = flying([0, 0, 6, 0], [40, 0, 6, 0], 2.5, {0: 9, 2: 9})
    position, velocity = now.memory.leg.derivatives(2.5, 2)
    assert velocity[0] > 2.5 and position[0] < 15.0
    leg = LEGS.plan_stop(now)
    end = leg.derivatives(leg.duration, 1)[0]
    assert position[0] < end[0] < 20.0


@pytest.mark.parametrize("counts, good", [({}, True), ({0: 9, 2: 9}, False), ({2: 9}, False)])
def test_the_rest_of_a_leg_is_checked_as_the_map_grows(counts, good):
    now = flying([0, 0, 6, 0], [40, 0, 6, 0], 1.0, counts)
    assert LEGS.is_clear(now, []) is good
    late = dc.replace(now, time=now.memory.leg.duration)
    assert LEGS.is_clear(late, [])
