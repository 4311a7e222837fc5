from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.multibody.plant import ContactResults
from pydrake.systems.analysis import Simulator

from airrace.systems.referee import Referee, nearest_name
from airrace.systems.types import ExplorerStatus
from airrace.track import load_track
from airrace.vehicle.disturbances import RotorFailure

TRACK = load_track("student-airrace")
COURSE = load_track("grand-prix")
DT = 0.01


def judge(
    path,
    velocity=(1.0, 2.0, 2.0),
    laps=1,
    racing=True,
    time_limit=1e3,
    contacts=None,
    rotor_failures=(),
    gate_shifts=None,
    explorer=None,
    pushed=False,
    track=TRACK,
    contacts_end=True,
):
    """Shows the referee a path, one position a step, and returns its report."""
    referee = Referee(
        track=track,
        laps=laps,
        period=DT,
        time_limit=time_limit,
        arena_margin=60.0,
        standing_height=track.start.position[2] + 0.1,
        body_names={},
        rotor_failures=rotor_failures,
        moving_gates=gate_shifts is not None,
        contacts_end=contacts_end,
    )
    simulator = Simulator(referee)
    context = simulator.get_mutable_context()
    referee.GetInputPort("contact_results").FixValue(context, Value(contacts or ContactResults()))
    referee.GetInputPort("contact_impulse").FixValue(context, np.zeros(6))
    status = explorer or ExplorerStatus(done=racing)
    referee.GetInputPort("explorer_status").FixValue(context, Value[object](status))
    assert referee.HasInputPort("gate_shifts") == (gate_shifts is not None)
    if gate_shifts is not None:
        referee.GetInputPort("gate_shifts").FixValue(context, np.ravel(gate_shifts))
    for k, p in enumerate(path):
        state = np.concatenate([[1, 0, 0, 0], p, np.zeros(3), velocity])
        referee.GetInputPort("state").FixValue(context, state)
        if pushed and k == len(path) - 1:
            referee.GetInputPort("contact_impulse").FixValue(context, np.ones(6))
        simulator.AdvanceTo((k + 0.5) * DT)
    return referee.GetOutputPort("referee_status").Eval(context)


def through(gate, side=0.0, height=6.25, distance=0.4):
    """Two positions, before and behind a gate."""
    middle = gate.p_WG * [1, 1, 0] + side * gate.rightward + [0, 0, height]
    return [middle - distance * gate.forward, middle + distance * gate.forward]


def lap_path(**kwargs):
    return [p for gate in TRACK.gates for p in through(gate, **kwargs)]


def test_a_lap_runs_from_gate_1_to_gate_1():
    report = judge(lap_path(side=3.0, height=5.25) + through(TRACK.gates[0]))
    assert report.finished and report.over and report.dnf_reason is None
    assert [c.gate for c in report.crossings] == [*range(1, 11), 1]
    assert [c.lap for c in report.crossings] == [1] * 10 + [2]
    assert report.crossings[0].offset == pytest.approx(np.hypot(3.0, 1.0))
    assert report.crossings[0].max_speed == pytest.approx(3.0)
    # Half-way between the two steps.
    assert report.crossings[0].time == pytest.approx(0.5 * DT)
    assert report.end_time == pytest.approx(20.5 * DT)
    assert report.collisions == 0


@pytest.mark.parametrize("kwargs", [dict(side=5.01), dict(side=-5.01), dict(height=12.01)])
def test_beside_and_above_do_not_count(kwargs):
    assert judge(lap_path(**kwargs)).crossings == ()


def test_backwards_and_out_of_order_do_not_count():
    gates = TRACK.gates
    assert judge(through(gates[0])[::-1]).crossings == ()
    assert judge(through(gates[1]) + through(gates[2])).crossings == ()
    skipped = judge(through(gates[0]) + through(gates[2]) + through(gates[1]))
    assert [c.gate for c in skipped.crossings] == [1, 2]


def test_nothing_counts_while_exploring():
    assert judge(lap_path(), racing=False).crossings == ()


def test_the_crossing_time_is_interpolated():
    gate = TRACK.gates[0]
    before, behind = through(gate, distance=1.0)
    p = before + 0.1 * (behind - before)  # 0.8 m before the gate
    q = before + 0.6 * (behind - before)  # 0.2 m behind it
    assert judge([p, q]).crossings[0].time == pytest.approx(0.8 * DT)


def test_arena_and_time_limit():
    assert judge([[0, 0, 61.0]]).dnf_reason == "left the arena"
    assert judge([[500.0, 0, 5]]).dnf_reason == "left the arena"
    report = judge([[0, 0, 5.0]] * 20, time_limit=0.1)
    assert report.dnf_reason == "ran out of time"
    assert report.end_time == pytest.approx(0.1)
    assert judge([[np.nan, 0, 5.0]]).dnf_reason == "the simulation failed"


def test_nothing_counts_after_the_end():
    report = judge([[0, 0, 61.0], *lap_path()])
    assert report.crossings == () and not report.finished


def test_a_reason_names_the_rotors_that_had_failed():
    failures = [RotorFailure(3, 5 * DT), RotorFailure(1, 2 * DT), RotorFailure(2, 99.0)]
    flight = [[0, 0, 5.0]] * 5
    reason = judge([*flight, [0, 0, 61.0]], rotor_failures=failures).dnf_reason
    assert reason == "left the arena after rotors 1 and 3 had failed"
    reason = judge([*flight[:4], [0, 0, 61.0]], rotor_failures=failures).dnf_reason
    assert reason == "left the arena after rotor 1 had failed"
    assert judge([[0, 0, 61.0]], rotor_failures=failures).dnf_reason == "left the arena"
    # Neither the clock nor a race that is finished has to do with rotors.
    late = judge(flight * 4, rotor_failures=failures, time_limit=10 * DT)
    assert late.dnf_reason == "ran out of time"
    whole = judge(lap_path() + through(TRACK.gates[0]), rotor_failures=failures)
    assert whole.finished and whole.dnf_reason is None


def test_gates_count_where_they_stand():
    shifts = np.random.default_rng(2).uniform(-2.0, 2.0, (len(TRACK.gates), 2))
    moved = TRACK.shifted(shifts)
    path = [p for gate in moved.gates for p in through(gate, side=4.9)]
    report = judge(path + through(moved.gates[0]), gate_shifts=shifts)
    assert report.finished
    np.testing.assert_allclose([c.offset for c in report.crossings], [4.9] * 10 + [0.0], atol=1e-9)
    np.testing.assert_allclose(
        [c.time for c in report.crossings], DT * (2 * np.arange(11) + 0.5), atol=1e-9
    )
    # Where the gate was is beside it, or elsewhere along the flight.
    gate = TRACK.gates[0]
    aside = np.zeros_like(shifts)
    aside[0] = 2.0 * gate.rightward[:2]
    assert judge(through(gate, side=-4.0), gate_shifts=aside).crossings == ()
    assert len(judge(through(gate, side=-4.0), gate_shifts=0 * aside).crossings) == 1
    onwards = np.zeros_like(shifts)
    onwards[0] = 2.0 * gate.forward[:2]
    assert judge(through(gate), gate_shifts=onwards).crossings == ()


def test_gates_that_did_not_move_are_judged_as_those_that_cannot():
    path = lap_path(side=3.0) + through(TRACK.gates[0])
    still = judge(path, gate_shifts=np.zeros((len(TRACK.gates), 2)))
    assert still.crossings == judge(path).crossings


LANDING = ExplorerStatus(state="LAND", reason="the IMU fell silent", since=3.0)
LOST = "the drone gave up at 3.0 s (the IMU fell silent)"


def test_a_reason_names_why_a_drone_was_landing():
    report = judge([(0.0, 0.0, 5.0), (1e3, 0.0, 5.0)], explorer=LANDING)
    assert report.dnf_reason == f"left the arena: {LOST}"
    report = judge([(0.0, 0.0, 5.0)] * 3, explorer=LANDING, time_limit=0.015)
    assert report.dnf_reason == f"ran out of time: {LOST}"


@pytest.mark.parametrize(("climb", "end"), [(5.0, "came down"), (0.0, "stayed on its pad")])
def test_a_landing_is_no_collision(monkeypatch, climb, end):
    monkeypatch.setattr(Referee, "_touched", lambda self, context, airborne: "ground")
    pad = np.add(TRACK.start.position, [0.0, 0.0, 0.1])
    path = [pad, pad + [0.0, 0.0, climb], pad]
    report = judge(path, explorer=LANDING, pushed=True)
    assert (report.dnf_reason, report.collisions) == (f"{LOST}, and {end}", 0)
    report = judge(path, pushed=True)
    assert (report.dnf_reason, report.collisions) == ("hit the ground", 1)


def course_path(**place):
    return [p for gate in COURSE.gates for p in through_square(gate, **place)]


def through_square(gate, side=0.0, height=0.0):
    """Two positions, before and behind a square gate."""
    return [gate.X_WG @ np.array([x, -side, height]) for x in (-0.4, 0.4)]


def judge_course(path, **options):
    return judge(path, velocity=(3.0, 0.0, 4.0), track=COURSE, **options)


def test_a_course_runs_from_the_first_gate_to_the_last():
    report = judge_course(course_path(side=0.3, height=-0.4))
    assert report.finished and report.dnf_reason is None
    assert [c.gate for c in report.crossings] == list(range(1, 18))
    assert {c.lap for c in report.crossings} == {1}
    np.testing.assert_allclose([c.offset for c in report.crossings], 0.5, atol=1e-9)
    assert report.crossings[0].max_speed == pytest.approx(5.0)
    assert report.crossings[0].time == pytest.approx(0.5 * DT)
    assert report.end_time == pytest.approx(32.5 * DT)


@pytest.mark.parametrize(
    "place", [dict(side=0.76), dict(side=-0.76), dict(height=0.76), dict(height=-0.76)]
)
def test_only_the_inner_square_counts(place):
    assert judge_course(course_path(**place)).crossings == ()
    closer = {name: 0.98 * value for name, value in place.items()}
    assert judge_course(course_path(**closer)).finished


def test_square_gates_count_in_order_from_the_front_once_armed():
    first, second, third = map(through_square, COURSE.gates[:3])
    assert judge_course(first[::-1]).crossings == ()
    assert judge_course(second).crossings == ()
    assert [c.gate for c in judge_course(first + third).crossings] == [1]
    assert judge_course(course_path(), racing=False).crossings == ()


def test_contacts_may_end_the_race_or_not():
    path = [[0.0, 0.0, 3.0], *course_path()]
    assert judge_course(path, contacts_end=False, pushed=True).finished


def test_the_arena_lies_around_all_frames():
    report = judge_course([[0.0, 0.0, 3.0], [300.0, 0.0, 3.0]])
    assert report.dnf_reason == "left the arena"


def test_what_another_drone_touches_is_not_held_against_this_one():
    names = {1: "ground", 2: "another drone", 3: "pylon_1_left"}  # 9 is its own
    others, own = (
        SimpleNamespace(id_A=2, id_B=1, distance=-0.1),
        SimpleNamespace(id_A=9, id_B=3, distance=0.2),
    )

    def name(touching):
        contacts = SimpleNamespace(
            num_point_pair_contacts=lambda: len(touching),
            point_pair_contact_info=lambda i: SimpleNamespace(point_pair=lambda: touching[i]),
        )
        query = SimpleNamespace(ComputeSignedDistancePairwiseClosestPoints=lambda: [others, own])
        return nearest_name(contacts, query, names, airborne=True)

    assert name([others, own]) == name([others]) == name([]) == "pylon_1_left"
