import dataclasses as dc
import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.scenario import ExplorerConfig
from airrace.systems.exploring import search
from airrace.systems.exploring.exploration import gate_pose
from airrace.systems.exploring.explorer_memory import Memory
from airrace.track.rules import FARTHEST_VIEW, LENGTHS
from airrace.trajopt.flat_trajectory import FlatTrajectory
from tests.systems.exploring.test_exploration import situation

CONFIG = ExplorerConfig()
HOME = np.array([0.0, 0.0, 5.0, 0.3])
# From a gate's midpoint to the next, along the line straight on from it.
LONGEST_LEG = LENGTHS[1] + 5.0 / np.sqrt(2.0)
STEP_LENGTHS = st.floats(2.0, 25.0)


def steps(*args, count=1, config=CONFIG, **kwargs):
    return list(itertools.islice(search.next_steps(searching(*args, **kwargs), config), count))


def searching(counts, in_image=(), last=None, goal=HOME, **memory):
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
    return dc.replace(now, memory=made)


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


def searched_ahead(step_length):
    """Steps of a search beyond gate 1, until the drone is lost and goes back."""
    config = dc.replace(CONFIG, step_length=step_length)
    found = steps({0: 9, 2: 9}, last=0, count=200, config=config)
    return list(itertools.takewhile(lambda step: step.state != "GO_BACK", found))


@pytest.mark.slow
@given(STEP_LENGTHS)
def test_every_metre_ahead_is_searched_whatever_the_length_of_a_step(step_length):
    """As far beyond the gate as the rules allow the next, and there is no gap in between."""
    found = searched_ahead(step_length)
    base = 20.0 + CONFIG.passing_distance  # gate 1 is at x = 20
    end = 20.0 + LONGEST_LEG
    forward, looks = (
        [step.routes[-1][-1][0] for step in found if step.state == state]
        for state in ("STEP_FORWARD", "LOOK_AROUND")
    )
    assert np.all(np.diff([base, *forward]) > 0.0) and forward[-1] == pytest.approx(end)
    assert np.max(np.diff([base, *forward])) <= min(step_length, FARTHEST_VIEW) + 1e-9
    # A gate at any distance can be read from some look around, which are no farther apart.
    sides = np.rad2deg([step.routes[-1][-1][3] for step in found if step.state == "LOOK_AROUND"])
    np.testing.assert_allclose(sides, len(looks) // 2 * [60.0, -60.0])
    assert end - looks[0] < FARTHEST_VIEW and looks[-1] == pytest.approx(end)
    assert np.max(np.diff(looks)) <= FARTHEST_VIEW


@pytest.mark.slow
@given(STEP_LENGTHS)
def test_no_step_leads_beyond_the_longest_leg(step_length):
    config = dc.replace(CONFIG, step_length=step_length)
    for last, base in ((0, [20.0, 0.0]), (None, HOME[:2])):
        for step in steps({0: 9, 2: 9}, last=last, count=200, config=config):
            for route in step.routes:
                # To give way to an obstacle, a step may go to the side.
                aside = 4.0 * (step.state == "STEP_FORWARD")
                far = np.linalg.norm(route[-1][:2] - base)
                assert far <= np.hypot(LONGEST_LEG, aside) + 1e-9


def test_from_above_viewpoints_are_the_same_whatever_the_length_of_a_step():
    def from_above(step_length):
        config = dc.replace(CONFIG, step_length=step_length)
        found = steps({0: 9, 2: 9}, last=0, count=150, config=config)
        poses = [s.routes[-1][-1] for s in found if s.routes[-1][-1][2] > 13.0]
        return np.array(poses[: 1 + 5 + 3 * 12])

    np.testing.assert_array_equal(from_above(2.0), from_above(25.0))
    ahead = np.unique(from_above(5.0)[:21, 0])
    assert np.diff(ahead).max() < FARTHEST_VIEW / 2


@pytest.mark.parametrize("step_length", [2.0, 5.0, 15.0, 25.0])
@pytest.mark.parametrize("last", [None, 0])
def test_a_drone_is_lost_once_it_goes_back(step_length, last):
    config = dc.replace(CONFIG, step_length=step_length)
    count = steps({0: 9, 2: 9}, last=last, count=200, config=config)
    back = next(step.steps for step in count if step.state == "GO_BACK")
    for taken, lost in ((0, False), (back - 1, False), (back, True), (back + 1, True)):
        now = searching({0: 9, 2: 9}, last=last, steps=taken)
        assert search.is_lost(now, config) is lost


def test_a_step_that_is_longer_than_the_search_ends_with_it():
    (far,) = steps({0: 9, 2: 9}, last=0, config=dc.replace(CONFIG, step_length=1e9))
    np.testing.assert_allclose(far.routes[0][-1][0], 20.0 + LONGEST_LEG)
    nowhere = dc.replace(CONFIG, passing_distance=1e3)
    assert steps({0: 9, 2: 9}, last=0, config=nowhere)[0].state == "GO_BACK"


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
