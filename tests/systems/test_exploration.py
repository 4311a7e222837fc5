import types

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from airrace.diagrams.scenario import ExplorerConfig
from airrace.systems import exploration
from airrace.systems.marker_statistics import MarkerStatistics, make_map
from airrace.systems.types import Detection, Detections
from airrace.track import load_track
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.leg import plan_leg

TRACK = load_track("student-airrace")
BOARDS = {board.id: board.X_WM for board in TRACK.boards()}
CONFIG = ExplorerConfig()


def situation(counts, in_image, last=None, p=(0.0, 0.0, 5.0), stepped_around=False, steps=0):
    """What the explorer knows with some markers mapped and some in the image."""
    statistics = {
        id: MarkerStatistics(
            n, 0, BOARDS[id].translation() if id in BOARDS else np.zeros(3), np.zeros(3),
            n * BOARDS[id].rotation().col(2) if id in BOARDS else np.ones(3))
        for id, n in counts.items()
    }
    gate_map = make_map(statistics, min_sightings=5, time=0.0, detections=0, out_of_range=0)
    gates = {gate.number: gate for gate in gate_map.gates}
    memory = types.SimpleNamespace(
        last=None if last is None else gates[last], stepped_around=stepped_around,
        steps=steps,
        leg=FlatTrajectory.resting([*p, 0.3]),
    )
    markers = tuple(
        Detection(id, np.zeros((4, 2)), RigidTransform(), 0.0) for id in in_image
    )
    q = RollPitchYaw(0, 0, 0.3).ToQuaternion().wxyz()
    return exploration.Now(
        memory=memory, time=1.0, detections=Detections(1.0, markers), gate_map=gate_map,
        estimate=np.array([1.0, *q, *p, *np.zeros(6)]),
    )


def found(*args, **kwargs):
    gate = exploration.next_gate(situation(*args, **kwargs), CONFIG.closing_range)
    return None if gate is None else gate.number


ALL = {id: 10 for gate in range(10) for id in (4 * gate, 4 * gate + 2)}


def test_the_first_gate_needs_both_markers_in_one_image_and_in_the_map():
    assert found({0: 9, 2: 9}, [0, 2]) == 0
    assert found({0: 9, 2: 9}, [0]) is None
    assert found({0: 9, 2: 4}, [0, 2]) is None
    assert found({4: 9, 6: 9}, [4, 6]) is None  # gate 2 is not next


def test_the_loop_closes_with_gate_1_near():
    near = (-5.0, -25.0, 6.0)
    assert found(ALL, [0, 2], last=9, p=near) == 0
    assert found(ALL, [0], last=9, p=near) is None
    assert found(ALL, [0, 2], last=9, p=(-60.0, 30.0, 6.0)) is None
    assert found(ALL, [0, 2], last=1, p=near) is None


def test_what_is_known_of_a_next_gate_keeps_the_loop_open_but_a_stray_id_does_not():
    near = (-5.0, -25.0, 6.0)
    assert found({**ALL, 40: 3}, [0, 2], last=9, p=near) is None
    assert found({**ALL, 40: 1}, [0, 2], last=9, p=near) == 0


def test_steps_around_a_lone_marker():
    now = situation({2: 9}, [2])
    pose, state, _ = exploration.search_target(now, CONFIG)
    assert state == "STEP_AROUND"
    # 20 m before the right board, and 5 m towards the middle of the gate.
    np.testing.assert_allclose(pose, [-1.0, 0.0, 6.25, 0.0], atol=1e-9)


def test_the_left_marker_alone_counts_only_from_near():
    assert exploration.search_target(situation({0: 9}, [0]), CONFIG)[1] == "STEP_FORWARD"
    near = situation({0: 9}, [0], p=(14.0, 5.0, 6.0))
    pose, state, _ = exploration.search_target(near, CONFIG)
    assert state == "STEP_AROUND"
    np.testing.assert_allclose(pose, [-1.0, 0.0, 6.25, 0.0], atol=1e-9)


@pytest.mark.parametrize("counts, in_image, stepped", [
    ({}, [], False),
    ({2: 2}, [2], False),  # perhaps a stray
    ({2: 9}, [], True),  # that is not where it was
    ({2: 9}, [2], True),  # that did not help
    ({0: 9, 2: 4}, [0, 2], False),  # both in sight
])
def test_otherwise_steps_forward(counts, in_image, stepped):
    now = situation(counts, in_image, stepped_around=stepped)
    pose, state, _ = exploration.search_target(now, CONFIG)
    assert state == "STEP_FORWARD"
    step = CONFIG.step_length * np.array([np.cos(0.3), np.sin(0.3), 0.0])
    np.testing.assert_allclose(pose, [*(step + [0, 0, 5]), 0.3], atol=1e-9)


@pytest.mark.parametrize("counts, id", [({0: 9, 2: 9}, 2), ({2: 9}, 2), ({0: 9}, 0)])
def test_steps_around_what_was_in_sight(counts, id):
    pose, state, reason = exploration.search_target(situation(counts, []), CONFIG)
    assert (state, reason) == ("STEP_AROUND", f"marker {id} of gate 1 was in sight")
    np.testing.assert_allclose(pose, [-1.0, 0.0, 6.25, 0.0], atol=1e-9)


@pytest.mark.parametrize("steps, state, turn, ahead", [
    (1, "STEP_FORWARD", 0, 15), (2, "STEP_FORWARD", 0, 15), (3, "LOOK_AROUND", 60, 0),
    (4, "LOOK_AROUND", -120, 0), (5, "STEP_FORWARD", 60, 15), (6, "STEP_FORWARD", 0, 15),
])
def test_looks_left_and_right_after_three_steps_in_vain(steps, state, turn, ahead):
    """And then on along the heading that it had before."""
    pose, found, _ = exploration.search_target(situation({}, [], steps=steps), CONFIG)
    yaw = 0.3 + np.deg2rad(turn)
    step = [ahead * np.cos(yaw), ahead * np.sin(yaw), 0.0]
    assert found == state
    np.testing.assert_allclose(pose, [*(step + np.array([0, 0, 5])), yaw], atol=1e-9)


def test_a_larger_drone_needs_more_room():
    """Straight on, 2.2 m inside of the left pylon of gate 1."""
    gate_map = situation({0: 9, 2: 9}, []).gate_map
    (left, _), start = gate_map.gates[0].pylons, np.zeros((5, 4))
    start[0, 1:3] = left[1] - 2.2, 6.0
    leg = plan_leg(start, [[40.0, left[1] - 2.2, 6.0, 0.0]], max_speed=8.0, max_acceleration=6.0)
    assert exploration.is_clear(leg, gate_map, 2.1)
    assert not exploration.is_clear(leg, gate_map, 2.3)
    assert exploration.is_clear(leg, situation({}, []).gate_map, 2.3)


def test_tilt_and_yaw():
    q = RollPitchYaw(0.0, 0.2, 1.0).ToQuaternion().wxyz()
    estimate = np.array([0.0, *q, 1, 2, 3, *np.zeros(6)])
    assert exploration.tilt(estimate) == pytest.approx(0.2)
    np.testing.assert_allclose(exploration.hover_pose(estimate), [1, 2, 3, 1.0])
