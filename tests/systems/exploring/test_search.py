import dataclasses as dc
import itertools

import numpy as np
import pytest

from airrace.scenario import ExplorerConfig
from airrace.systems.exploring import search
from airrace.systems.exploring.exploration import gate_pose
from airrace.systems.exploring.explorer_memory import Memory
from airrace.trajopt.flat_trajectory import FlatTrajectory
from tests.systems.exploring.test_exploration import situation

CONFIG = ExplorerConfig()
HOME = np.array([0.0, 0.0, 5.0, 0.3])


def steps(counts, in_image=(), last=None, goal=HOME, count=1, **memory):
    now = situation(counts, in_image, last)
    status = now.memory.status
    made = dc.replace(
        Memory(),
        status=status,
        last=now.memory.last,
        home=HOME,
        leg=FlatTrajectory.resting(goal),
        **memory,
    )
    now = dc.replace(now, memory=made)
    return list(itertools.islice(search.next_steps(now, CONFIG), count))


def test_the_start_looks_all_round_before_it_steps():
    looks = steps({}, count=6)
    assert [s.state for s in looks] == 5 * ["LOOK_AROUND"] + ["STEP_FORWARD"]
    seen = {0.0}
    for step in looks[:5]:
        (x, y, z, yaw) = step.routes[0][-1]
        assert (x, y, z) == tuple(HOME[:3])
        seen.add(np.rad2deg(yaw - HOME[3]) % 360)
    assert np.allclose(sorted(seen), np.arange(0, 360, 60))
    assert looks[0].reason == "no gate ahead, looking 60 degrees left"


def test_after_a_gate_it_steps_forward_along_its_heading():
    first, second, third, left, right = steps({0: 9, 2: 9}, last=0, count=5)
    for k, step in enumerate((first, second, third), 1):
        assert step.state == "STEP_FORWARD" and step.steps == k
        np.testing.assert_allclose(step.routes[0][-1], [25.0 + 15.0 * k, 0.0, 6.25, 0.0], atol=1e-9)
    assert first.reason == "no gate in sight" and third.reason == "still no gate in sight"
    assert left.state == right.state == "LOOK_AROUND"
    np.testing.assert_allclose(left.routes[0][-1], [70.0, 0.0, 6.25, np.pi / 3])


def test_a_search_never_ends_and_comes_back_and_up_again_and_again():
    found = steps({0: 9, 2: 9}, last=0, count=200)
    states = [step.state for step in found]
    assert states.count("GO_BACK") > 2
    back = states.index("GO_BACK")
    assert found[back].reason == "lost, back to gate 1" and found[back].steps_around == 0
    np.testing.assert_allclose(found[back].routes[-1][-1], [25.0, 0.0, 6.25, 0.0], atol=1e-9)
    assert "LOOK_FROM_ABOVE" not in states[:back]
    assert all(step.routes[-1][-1][2] > 13.0 for step in found if step.state == "LOOK_FROM_ABOVE")
    assert [step.steps for step in found] == list(range(1, 201))


def test_the_next_step_is_that_after_the_last():
    assert [s.state for s in steps({0: 9, 2: 9}, last=0, steps=3, count=2)] == 2 * ["LOOK_AROUND"]


@pytest.mark.parametrize("id", range(4))
def test_steps_around_what_was_seen_of_the_gate(id):
    """20 m before the boards of gate 1, whichever was seen."""
    found = steps({id: 9}, [id], count=7)
    assert [s.state for s in found[:6]] == 6 * ["STEP_AROUND"]
    assert [s.steps_around for s in found[:6]] == [1, 2, 3, 4, 5, 6]
    np.testing.assert_allclose(found[0].routes[0][-1], [-1.0, 0.0, 6.25, 0.0], atol=1e-9)
    assert f"only marker {id} of gate 1 is in sight" in found[0].reason
    for step in found[:6]:  # all look at the gate
        x, y, _, yaw = step.routes[0][-1]
        assert np.arctan2(-y, 20.0 - x) == pytest.approx(yaw, abs=0.05)
    assert found[6].state == "LOOK_AROUND"


def test_steps_around_that_were_tried_are_not_tried_again():
    assert steps({2: 9}, [2], steps_around=5)[0].steps_around == 6
    assert steps({2: 9}, [2], steps_around=6)[0].state == "LOOK_AROUND"


def test_a_stray_id_is_not_stepped_around():
    assert steps({2: 2}, [2])[0].state == "LOOK_AROUND"


def test_a_gate_that_is_still_far_asks_for_a_step_on():
    """Gate 2 is 23 m beyond gate 1; at first only its left marker can be read."""
    seen = {0: 9, 2: 9, 4: 9}
    far = steps(seen, last=0, goal=[18.0, 0.0, 6.0, 0.0], count=2)
    # A step of 15 m from beyond gate 1 would end at gate 2.
    assert [s.state for s in far] == 2 * ["STEP_AROUND"]
    seen = {16: 9, 18: 9, 20: 9}
    now = situation(seen, [], last=4)
    goal = gate_pose(now.last, 5.0)
    (first,) = steps(seen, last=4, goal=goal)
    assert first.state == "STEP_FORWARD"  # gate 6 is 70 m away


def test_a_blocked_step_forward_may_give_way():
    (step,) = steps({0: 9, 2: 9}, last=0, goal=[25.0, 0.0, 6.25, 0.0])
    ends = np.array([route[-1] for route in step.routes])
    np.testing.assert_allclose(ends[:, 1], [0.0, 4.0, -4.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(ends[3], [32.5, 0.0, 6.25, 0.0], atol=1e-9)
    assert step.routes[4][0][2] > 13.0
