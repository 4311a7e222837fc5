import types

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw

from airrace.scenario import ExplorerConfig
from airrace.systems.exploring import exploration
from airrace.systems.exploring.explorer_memory import Memory, Situation
from airrace.systems.mapping.original_estimator import EMPTY, OriginalEstimator
from airrace.systems.types import Detection, Detections, ExplorerStatus
from airrace.track import load_track
from airrace.track.gate_map import GateEstimate
from airrace.track.generator import generate_track

TRACK = load_track("student-airrace")
CONFIG = ExplorerConfig()


def mapped(counts, track=TRACK):
    """The map after so many true observations of markers, ID to number."""
    boards = {board.id: board.X_WM for board in track.boards()}
    statistics = {}
    for id, n in counts.items():
        X_WM = boards.get(id, RigidTransform([1.0, 1.0, 1.0]))
        statistics[id] = EMPTY
        for _ in range(n):
            p_WM, normal = X_WM.translation(), X_WM.rotation().col(2)
            statistics[id] = statistics[id].updated(p_WM, normal, 3.0)
    estimator = OriginalEstimator(outlier_sigma=3.0, min_observations=5)
    return estimator.make_map(statistics, time=0.0, detections=0, out_of_range=0)


def situation(counts, in_image, last=None, p=(0.0, 0.0, 5.0), track=TRACK):
    """What the explorer knows with some markers mapped and some in the image."""
    gate_map = mapped(counts, track)
    gates = {gate.number: gate for gate in gate_map.gates}
    memory = Memory(
        last=None if last is None else gates[last],
        status=ExplorerStatus(gates=() if last is None else tuple(range(last + 1))),
    )
    markers = tuple(Detection(id, np.zeros((4, 2)), RigidTransform(), 0.0) for id in in_image)
    q = RollPitchYaw(0, 0, 0.3).ToQuaternion().wxyz()
    return Situation(
        memory=memory,
        time=1.0,
        detections=Detections(1.0, markers),
        gate_map=gate_map,
        estimate=np.array([1.0, *q, *p, *np.zeros(6)]),
    )


def found(*args, is_lost=False, **kwargs):
    gate = exploration.next_gate(situation(*args, **kwargs), CONFIG.closing_range, is_lost)
    return None if gate is None else gate.number


ALL = {id: 10 for gate in range(10) for id in (4 * gate, 4 * gate + 2)}
NEAR_GATE_1 = (-5.0, -25.0, 6.0)


def test_the_next_gate_is_found_once_both_pylons_are_in_the_map():
    assert found({0: 9, 2: 9}, []) == 0


def test_one_pylon_or_another_gate_is_not_the_next_gate():
    assert found({0: 9, 2: 4}, [0, 2]) is None
    assert found({0: 9, 1: 9}, [0]) is None
    assert found({4: 9, 6: 9}, [4, 6]) is None  # gate 2 is not next


def test_the_loop_closes_with_gate_1_near_and_in_sight():
    assert found(ALL, [0, 2], last=9, p=NEAR_GATE_1) == 0
    assert found(ALL, [2], last=9, p=NEAR_GATE_1) == 0
    assert found(ALL, [1, 3, 40], last=9, p=NEAR_GATE_1) is None
    assert found(ALL, [0, 2], last=9, p=(-60.0, 30.0, 6.0)) is None
    assert found({0: 9, 2: 9, 4: 9, 6: 9}, [0, 2], last=1, p=NEAR_GATE_1) is None


def test_what_is_known_of_a_next_gate_keeps_the_loop_open_but_a_stray_id_does_not():
    assert found({**ALL, 40: 3}, [0, 2], last=9, p=NEAR_GATE_1) is None
    assert found({**ALL, 40: 1}, [0, 2], last=9, p=NEAR_GATE_1) == 0


@pytest.mark.parametrize("last", range(2, 9))
def test_the_loop_does_not_close_before_the_last_gate(last):
    """Even if gate 1 is near."""
    seen = {id: n for id, n in ALL.items() if id // 4 <= last}
    assert found(seen, [0, 2], last=last, p=(10.0, 0.0, 6.0)) is None


@pytest.mark.parametrize("seed", range(8))
def test_only_the_gate_that_comes_next_obeys_the_rule(seed):
    track = generate_track(seed)
    gates = mapped({b.id: 9 for b in track.boards()}, track).gates
    n = len(gates)
    follows = [
        (i, j)
        for i in range(n)
        for j in range(n)
        if i != j and exploration.obeys_rule(gates[i], gates[j])
    ]
    assert {(i, (i + 1) % n) for i in range(n)} <= set(follows)
    # Some other gate may happen to stand on the line, but never gate 1 nearby.
    assert all(
        np.linalg.norm(gates[i].p_WG - gates[0].p_WG) > 40.0
        for i, j in follows
        if j == 0 and i != n - 1
    )


@pytest.mark.parametrize("y, heading_deg, closes", [(-10.0, 15.0, True), (10.0, 260.0, False)])
def test_off_the_rule_gate_1_closes_the_loop_if_it_is_ahead(y, heading_deg, closes):
    gates = {0: (30.0, 0.0, 0.0), 1: (30.0, 40.0, 120.0), 2: (0.0, y, heading_deg)}
    made = tuple(
        GateEstimate(k, np.array([x, y, 6.25]), float(np.deg2rad(h)), 10.0)
        for k, (x, y, h) in gates.items()
    )
    now = situation({}, [0, 2], p=(15.0, 0.0, 6.0))
    memory = Memory(last=made[2], status=ExplorerStatus(gates=(0, 1, 2)))
    looking = types.SimpleNamespace(gates=made, markers=())
    now = Situation(memory, 1.0, now.detections, looking, now.estimate)
    assert exploration.next_gate(now, 40.0) is (made[0] if closes else None)


@pytest.mark.slow
@given(st.integers(0, 9), st.integers(0, 3))
def test_any_board_tells_where_its_gate_should_be(number, board):
    gate = exploration.presumed_gate(mapped({4 * number + board: 9}), number)
    true = TRACK.gates[number]
    np.testing.assert_allclose(gate.p_WG, true.p_WG, atol=1e-9)
    np.testing.assert_allclose(gate.forward, true.forward, atol=1e-9)
    np.testing.assert_allclose(gate.pylons, [true.p_WL[:2], true.p_WR[:2]], atol=1e-9)


def test_a_stray_id_tells_nothing():
    assert exploration.presumed_gate(mapped({2: 2}), 0) is None
    assert exploration.presumed_gate(mapped({2: 9}), 1) is None


def test_pylons_and_gates_of_which_one_board_was_seen_are_known():
    gate_map = mapped({0: 9, 2: 9, 6: 9, 9: 9, 12: 1})
    expected = [
        p[:2]
        for p in (
            TRACK.gates[0].p_WL,
            TRACK.gates[0].p_WR,
            TRACK.gates[1].p_WR,
            TRACK.gates[2].p_WL,
        )
    ]
    np.testing.assert_allclose(exploration.known_pylons(gate_map), expected, atol=1e-9)
    assert [gate.number for gate in exploration.known_gates(gate_map)] == [0, 1, 2]
    assert exploration.known_pylons(mapped({})).shape == (0, 2)


@pytest.mark.parametrize(
    "counts, in_image, words",
    [
        ({2: 9}, [2], "only marker 2 of gate 1 is in sight"),
        ({2: 9}, [], "marker 2 of gate 1 was seen"),
        ({1: 9, 3: 4}, [1], "only markers 1 and 3 of gate 1 are in sight from behind"),
    ],
)
def test_observations_in_words(counts, in_image, words):
    assert exploration.describe_observation(situation(counts, in_image), 0) == words


@pytest.mark.parametrize(
    "yaw, error, words",
    [
        (0.0, 0.0, "0 degrees left"),
        (0.5, -0.5, "29 degrees right"),
        (-3.0, 3.0, "172 degrees left"),
        (3.5, 2 * np.pi - 3.5, "159 degrees left"),
    ],
)
def test_the_heading_is_checked_against_a_gate(yaw, error, words):
    """Gate 1 is straight along +x."""
    now = situation({0: 9, 2: 9}, [])
    now.estimate[1:5] = RollPitchYaw(0.05, -0.05, yaw).ToQuaternion().wxyz()
    found = exploration.heading_error(now, now.gates[0])
    assert found == pytest.approx(error, abs=0.01)
    assert exploration.angle_in_words(found) == words


def test_tilt_and_yaw():
    q = RollPitchYaw(0.0, 0.2, 1.0).ToQuaternion().wxyz()
    estimate = np.array([0.0, *q, 1, 2, 3, *np.zeros(6)])
    assert exploration.tilt(estimate) == pytest.approx(0.2)
    np.testing.assert_allclose(exploration.hover_pose(estimate), [1, 2, 3, 1.0])
    assert exploration.fault_on_pad(estimate, 12.0) is None
    assert exploration.fault_on_pad(estimate, 11.0).startswith("tilted by 11 degrees")
    estimate[8] = 0.5
    assert exploration.fault_on_pad(estimate, 12.0) == "moving, waiting for rest"


def test_once_a_search_was_in_vain_gate_1_may_follow_off_the_rule():
    seen = {id: n for id, n in ALL.items() if id // 4 <= 7}
    where = dict(last=7, p=(10.0, 0.0, 6.0))
    assert found(seen, [0, 2], **where) is None
    assert found(seen, [0], is_lost=True, **where) is None
    assert found(seen, [0, 2], is_lost=True, **where) == 0
