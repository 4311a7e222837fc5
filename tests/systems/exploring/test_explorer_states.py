"""The state machine alone: perfect flight, and a map that shows gates from where they can be read."""

import dataclasses as dc

import numpy as np
import pytest

from airrace.scenario import ExplorerConfig
from airrace.systems.exploring.exploration import gate_pose, yaw_of
from airrace.systems.exploring.explorer_memory import Memory, Situation
from airrace.systems.exploring.explorer_states import StateMachine
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.min_snap.leg import plan_leg
from airrace.trajopt.reference import NO_LIFT, as_reference
from airrace.vehicle.state import as_state
from tests.systems.exploring.test_exploration import TRACK, mapped, situation
from tests.worlds.cases import first
from tests.worlds.kinematic_flight import flat_state

TICK = 0.05  # s
HOME = np.array([0.0, 0.0, 5.0, 0.0])
READING_RANGE = 25.0  # m, of a marker


def front(*numbers):
    return {id: 9 for number in numbers for id in (4 * number, 4 * number + 2)}


def memory_at(pose, found, state):
    """The memory of a drone at rest that has found so many gates of the track student-airrace."""
    gates = mapped(front(*range(found))).gates
    memory = Memory(home=HOME, aligned=True, last=gates[-1])
    memory = memory.flying(FlatTrajectory.resting(np.asarray(pose, float)), 0.0)
    return memory.entered(0.0, state, "test", gates=tuple(range(found)))


def search_on(config, found, seconds):
    """The memories of a drone that is beyond its last gate, tick by tick, until it finds one."""
    known = front(*range(found))
    gate = TRACK.gates[found]
    memory = memory_at(gate_pose(mapped(known).gates[-1], 5.0), found, "HOVER")
    machine = StateMachine(config=config, hover_height=5.0, clearance=2.0)
    passed = []
    for time in np.arange(0.0, seconds, TICK):
        estimate = flat_state(memory.leg.reference(time - memory.leg_start), time)
        near = np.linalg.norm(as_state(estimate).position - gate.p_WG) < READING_RANGE
        counts = {**known, **front(found)} if near else known
        looking = situation(counts, list(counts))
        memory = machine.next(
            Situation(memory, time, looking.detections, looking.gate_map, estimate)
        )
        passed.append((time, memory, estimate))
        if memory.status.state == "FLY_TO_GATE":
            break
    return passed


@pytest.mark.parametrize("step_length", first([2.0, 25.0, 5.0], 2))
def test_a_gate_at_the_end_of_a_long_leg_is_found_with_steps_of_any_length(step_length):
    """Gate 6 is 70 m from gate 5."""
    passed = search_on(ExplorerConfig(step_length=step_length), 5, 30.0)
    time, memory, _ = passed[-1]
    assert memory.status.state == "FLY_TO_GATE" and memory.status.gates[-1] == 5
    entered = [event.state for event in memory.status.events]
    assert set(entered[2:-1]) == {"STEP_FORWARD"}
    assert entered.count("STEP_FORWARD") <= 1 + (70.0 - READING_RANGE + 11.0) / step_length
    speeds = [np.linalg.norm(as_state(estimate).velocity) for _, _, estimate in passed]
    assert min(speeds[40:]) > 1.0  # it does not stop, once it flies
    assert time < 16.0


@pytest.mark.slow
@pytest.mark.parametrize("step_length", first([15.0, 5.0]))
def test_it_can_hover_before_each_step_forward(step_length):
    config = ExplorerConfig(step_length=step_length, hover_before_step=True, hover_time=1.0)
    passed = search_on(config, 5, 90.0)
    assert passed[-1][1].status.state == "FLY_TO_GATE"
    events = passed[-1][1].status.events
    steps = [k for k, event in enumerate(events) if event.state == "STEP_FORWARD"]
    assert len(steps) == np.ceil((68.5 - READING_RANGE) / step_length)
    assert all(events[k - 1].state == "HOVER" for k in steps)
    velocity = {time: as_state(estimate).velocity for time, _, estimate in passed}
    for k in steps[1:]:
        waiting = [v for t, v in velocity.items() if events[k].time - 0.9 < t <= events[k].time]
        assert len(waiting) > 15 and np.abs(waiting).max() < 1e-6


def test_hovering_before_each_step_begins_beyond_the_last_gate():
    """Without it, the first step goes on from the gate in flight."""
    for hovers, after in ((False, "STEP_FORWARD"), (True, "HOVER")):
        gate = mapped(front(*range(5))).gates[-1]
        memory = memory_at(gate_pose(gate, 5.0), 5, "FLY_TO_GATE")
        start = np.zeros((5, 4))
        start[0] = gate_pose(gate, 1.0)
        machine = StateMachine(
            config=ExplorerConfig(hover_before_step=hovers), hover_height=5.0, clearance=2.0
        )
        looking = situation(front(*range(5)), [])
        estimate = flat_state(memory.leg.reference(0.0), 1.0)
        now = Situation(memory, 1.0, looking.detections, looking.gate_map, estimate)
        assert machine.next(now).status.state == after
        leg = plan_leg(start, gate_pose(gate, 5.0)[None], max_speed=8.0, max_acceleration=6.0)
        flying = dc.replace(memory, leg_start=0.9, leg=leg)
        state = machine.next(dc.replace(now, memory=flying)).status.state
        assert state == ("FLY_TO_GATE" if hovers else "STEP_FORWARD")


@pytest.mark.parametrize("state", ["FLY_TO_GATE", "HOVER", "STEP_FORWARD"])
def test_with_all_gates_that_are_expected_it_returns(state):
    counts = front(*range(5))
    memory = memory_at(gate_pose(mapped(counts).gates[-1], 5.0), 5, state)
    looking = situation(counts, [])
    estimate = flat_state(memory.leg.reference(0.0), 1.0)
    now = Situation(memory, 1.0, looking.detections, looking.gate_map, estimate)
    for expected in (None, 4, 5, 6):
        config = ExplorerConfig(expected_gates=expected)
        after = StateMachine(config=config, hover_height=5.0, clearance=2.0).next(now)
        if expected == 5:
            assert after.status.state == "RETURN" and after.status.closed_at == 1.0
            assert after.status.reason == "all 5 gates that are expected were found"
            np.testing.assert_allclose(after.goal, HOME, atol=1e-6)
        else:
            assert after.status.state != "RETURN" and after.status.closed_at is None


def test_it_returns_through_the_gates_still_ahead():
    """The last one was just found, and is 20 m ahead."""
    counts = front(*range(5))
    gate = mapped(counts).gates[-1]
    memory = memory_at(gate_pose(gate, -20.0), 4, "HOVER")
    machine = StateMachine(config=ExplorerConfig(expected_gates=5), hover_height=5.0, clearance=2.0)
    looking = situation(counts, [16, 18])
    for time in (1.0, 1.0 + TICK):
        estimate = flat_state(memory.leg.reference(time - memory.leg_start), time)
        memory = machine.next(
            Situation(memory, time, looking.detections, looking.gate_map, estimate)
        )
    assert [event.state for event in memory.status.events[-2:]] == ["FLY_TO_GATE", "RETURN"]
    assert [ahead.number for ahead, _ in memory.gates_ahead] == [4]
    np.testing.assert_allclose(memory.goal, HOME, atol=1e-6)


def test_gate_1_closes_the_loop_behind_the_gate_at_which_it_was_seen():
    """Seen too late to plan around that gate, and out of sight behind it."""
    counts = front(*range(10))
    gate = mapped(counts).gates[-1]
    start = np.zeros((5, 4))
    start[0], start[1, :3] = gate_pose(gate, -2.0), 8.0 * gate.forward
    leg = plan_leg(start, gate_pose(gate, 9.0)[None], max_speed=8.0, max_acceleration=6.0)
    memory = dc.replace(
        memory_at(HOME, 10, "FLY_TO_GATE").flying(leg, 0.0), gates_ahead=((gate, 0.25),)
    )
    machine = StateMachine(
        config=ExplorerConfig(closing_range=60.0), hover_height=5.0, clearance=2.0
    )
    states = []
    for time, in_image in ((0.1, [0, 2]), (0.2, []), (0.3, [])):
        looking = situation(counts, in_image)
        estimate = flat_state(leg.reference(time), time)
        memory = machine.next(
            Situation(memory, time, looking.detections, looking.gate_map, estimate)
        )
        states.append(memory.status.state)
    assert states == ["FLY_TO_GATE", "FLY_TO_GATE", "RETURN"]
    assert memory.status.reason == "gate 1 again after 10 gates: the loop is closed"


@pytest.mark.parametrize(("drifts", "rest"), [(False, 0.5), (True, 2.0)])
def test_on_its_pad_it_rests_the_longer_if_it_has_to_find_its_way(drifts, rest):
    machine = StateMachine(config=ExplorerConfig(), hover_height=5.0, clearance=2.0, drifts=drifts)
    looking = situation({}, [])
    memory, time = Memory(), 0.0
    estimate = flat_state(FlatTrajectory.resting(np.zeros(4)).reference(0.0), 0.0)
    while memory.status.state == "CALIBRATE":
        time += TICK
        now = Situation(memory, time, looking.detections, looking.gate_map, estimate)
        memory = machine.next(now)
    assert memory.status.state == "TAKE_OFF" and time == pytest.approx(rest, abs=1.1 * TICK)


@pytest.mark.parametrize("state", ["CALIBRATE", "TAKE_OFF", "FLY_TO_GATE", "RETURN", "DONE"])
def test_without_an_estimate_it_lands_for_good(state):
    """Also in a race, when its own work is done; a drone on its pad stays there."""
    start = np.zeros((5, 4))
    start[0], start[1, :2] = [0.0, 0.0, 0.1 if state == "TAKE_OFF" else 6.0, 1.0], [9.0, 0.0]
    leg = plan_leg(start, np.array([[60.0, 0.0, 6.0, 1.0]]), max_speed=9.0, max_acceleration=6.0)
    memory = Memory() if state == "CALIBRATE" else Memory(home=HOME)
    memory = memory.flying(leg, 2.0).entered(2.0, state, "test", done=state == "DONE")
    machine = StateMachine(config=ExplorerConfig(), hover_height=5.0, clearance=2.0)
    estimate = flat_state(leg.reference(0.0), 2.0)
    looking = situation({}, [])
    now = Situation(
        memory, 2.0, looking.detections, looking.gate_map, estimate, "the IMU fell silent"
    )
    after = machine.next(now)
    assert (after.status.state, after.status.reason) == ("LAND", "the IMU fell silent")
    begin, last = (as_reference(after.leg.reference(t)) for t in (0.0, 30.0))
    if state == "TAKE_OFF":
        assert begin.acceleration[2] < NO_LIFT  # the rotors idle
    else:
        np.testing.assert_allclose(begin.velocity, [9.0, 0.0, 0.0], atol=1e-6)
        np.testing.assert_allclose(last.position[:2], [9.0**2 / 12.0, 0.0], atol=1e-6)
        assert last.position[2] < 0.0
    assert machine.next(dc.replace(now, memory=after, time=3.0, fault="")) is after


def fly_unsure(readable):
    """The events of a drone that is 30 m beyond its last gate, in vain, and is unsure of its place.

    Args:
        readable: whether it is sure again as soon as the gate is in its picture.
    """
    counts = front(*range(5))
    gate = mapped(counts).gates[-1]
    memory = dc.replace(memory_at(gate_pose(gate, 30.0), 5, "HOVER"), steps=2)
    machine = StateMachine(config=ExplorerConfig(), hover_height=5.0, clearance=2.0)
    drift = 1.5
    for time in np.arange(1.0, 20.0, TICK):
        estimate = flat_state(memory.leg.reference(time - memory.leg_start), time)
        to_gate = gate.p_WG - as_state(estimate).position
        ahead = to_gate @ [np.cos(yaw_of(estimate)), np.sin(yaw_of(estimate)), 0.0]
        if readable and 0.9 * np.linalg.norm(to_gate) < ahead < READING_RANGE:
            drift = 0.1
        looking = situation(counts, [])
        memory = machine.next(
            Situation(memory, time, looking.detections, looking.gate_map, estimate, "", drift)
        )
    return memory.status.events[1:]


@pytest.mark.slow
def test_a_drone_that_is_unsure_looks_at_a_known_gate_until_it_is_sure_again():
    """It turns as it flies nearer, and then searches from that gate: not so far away again."""
    events = fly_unsure(readable=True)
    states = [event.state for event in events]
    assert states[:3] == ["HOVER", "LOOK_BACK", "GO_BACK"]
    assert events[1].reason == "unsure of its place, looking at gate 5 again"
    assert events[2].time < fly_unsure(readable=False)[2].time - 1.0  # in sight, not there


@pytest.mark.slow
def test_unsure_in_vain_it_searches_on():
    """The gate is not where it should be: it looks for it there once, not for ever."""
    states = [event.state for event in fly_unsure(readable=False)]
    assert states[:4] == ["HOVER", "LOOK_BACK", "HOVER", "STEP_FORWARD"]
