"""Rewards, gates that count, and the ends of episodes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.envs import reward
from airrace.envs.reward import RewardWeights, judge, make_course
from airrace.track import load_track

TRACK = load_track("student-airrace")  # gate 1 at (20, 0), flown through along x
COURSE = make_course(TRACK, goal=11, arena_margin=60.0, standing_height=0.1)
WEIGHTS = RewardWeights()
STILL = np.zeros(3)
numbers = st.floats(-30.0, 30.0)


def step(before, p, w=STILL, touched=False, passed=0, airborne=True, weights=WEIGHTS):
    before, p, w = (np.array(x, float) for x in (before, p, w))
    return judge(before, p, w, touched, passed, airborne, COURSE, weights)


@given(q=st.tuples(numbers, numbers), p=st.tuples(numbers, numbers))
def test_progress_adds_up_to_the_distance_gained(q, p):
    """In front of the gate, the way does not matter: no reward is made by flying in circles."""
    q, p = (np.array([min(x, 19.0), y, 5.0]) for x, y in (q, p))
    there, back = step(q, p), step(p, q)
    c = TRACK.gates[0].p_WG
    assert there.reward == pytest.approx(np.linalg.norm(q - c) - np.linalg.norm(p - c))
    assert there.reward + back.reward == pytest.approx(0.0, abs=1e-9)
    assert there.outcome == reward.RUNNING


def test_a_gate_passed():
    judged = step((19.9, 1.0, 6.25), (20.2, 1.0, 6.25))
    assert judged.passed == 1 and judged.outcome == reward.RUNNING
    assert judged.reward == pytest.approx(WEIGHTS.gate, abs=0.5)


def test_the_last_gate_finishes():
    judged = step((19.9, 1.0, 6.25), (20.2, 1.0, 6.25), passed=10)
    assert judged.passed == 11 and judged.outcome == reward.FINISHED
    assert judged.reward > 0.0


@pytest.mark.parametrize("y, z", [(5.5, 6.0), (-5.5, 6.0), (0.0, 12.5)])
def test_a_gate_missed(y, z):
    judged = step((19.9, y, z), (20.2, y, z))
    assert judged.outcome == reward.MISSED_GATE and judged.passed == 0
    assert judged.reward == pytest.approx(WEIGHTS.failure, abs=0.5)


def test_from_behind_a_gate_neither_counts_nor_is_missed():
    judged = step((20.2, 1.0, 6.25), (19.9, 1.0, 6.25))
    assert judged.outcome == reward.RUNNING and judged.passed == 0


def test_a_contact_is_a_collision_only_in_flight():
    on_pad = step((0, 0, 0.1), (0, 0, 0.1), touched=True, airborne=False)
    assert on_pad.outcome == reward.RUNNING and not on_pad.airborne
    taking_off = step((0, 0, 0.45), (0, 0, 0.55), airborne=False)
    assert taking_off.outcome == reward.RUNNING and taking_off.airborne
    assert step((0, 0, 0.1), (0, 0, 0.1), touched=True).outcome == reward.COLLISION


def test_a_contact_comes_before_a_gate():
    judged = step((19.9, 4.0, 6.0), (20.2, 4.0, 6.0), touched=True)
    assert judged.outcome == reward.COLLISION and judged.passed == 0


@pytest.mark.parametrize("p", [(0, 0, 60.1), (-200, 0, 5), (0, 200, 5)])
def test_the_arena_ends(p):
    assert step(p, p).outcome == reward.LEFT_ARENA


def test_a_simulation_that_fails():
    judged = step((0, 0, 5), (np.nan, 0, 5))
    assert judged.outcome == reward.DIVERGED and judged.reward == WEIGHTS.failure


def test_weights_weigh():
    weights = RewardWeights(progress=2.0, rates=0.1, gate=3.0, failure=-1.0)
    judged = step((10, 0, 6.25), (11, 0, 6.25), w=(1, 2, 2), weights=weights)
    assert judged.reward == pytest.approx(2.0 - 0.9)
