"""The referee on a course of square gates."""

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.multibody.plant import ContactResults
from pydrake.systems.analysis import Simulator

from airrace.systems.referee import Referee
from airrace.systems.types import ExplorerStatus
from airrace.track.square_track import load_course

TRACK = load_course("grand-prix")
DT = 0.01


def judge(path, armed=True, contacts_end=True, pushed_at=()):
    """Shows the referee a path, one position a step, and returns its report."""
    referee = Referee(
        track=TRACK,
        laps=1,
        period=DT,
        time_limit=1e3,
        arena_margin=60.0,
        standing_height=0.1,
        body_names={},
        contacts_end=contacts_end,
    )
    simulator = Simulator(referee)
    context = simulator.get_mutable_context()
    referee.GetInputPort("contact_results").FixValue(context, Value(ContactResults()))
    status = ExplorerStatus(done=armed)
    referee.GetInputPort("explorer_status").FixValue(context, Value[object](status))
    pushes = 0
    for k, p in enumerate(path):
        state = np.concatenate([[1, 0, 0, 0], p, np.zeros(3), [3.0, 0.0, 4.0]])
        referee.GetInputPort("state").FixValue(context, state)
        pushes += k in pushed_at
        referee.GetInputPort("contact_impulse").FixValue(context, np.full(6, float(pushes)))
        simulator.AdvanceTo((k + 0.5) * DT)
    return referee.GetOutputPort("report").Eval(context)


def through(gate, side=0.0, height=0.0, distance=0.4):
    """Two positions, before and behind a gate."""
    return [gate.X_WG @ np.array([x, -side, height]) for x in (-distance, distance)]


def course_path(**kwargs):
    return [p for gate in TRACK.gates for p in through(gate, **kwargs)]


def test_a_course_runs_from_the_first_gate_to_the_last():
    report = judge(course_path(side=0.3, height=-0.4))
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
    assert judge(course_path(**place)).crossings == ()
    closer = {name: 0.98 * value for name, value in place.items()}
    assert judge(course_path(**closer)).finished


def test_gates_count_in_order_from_the_front_once_armed():
    gates = TRACK.gates
    assert judge(through(gates[0])[::-1]).crossings == ()
    assert judge(through(gates[1])).crossings == ()
    assert [c.gate for c in judge(through(gates[0]) + through(gates[2])).crossings] == [1]
    assert judge(course_path(), armed=False).crossings == ()


def test_contacts_may_end_the_race_or_not():
    path = [[0.0, 0.0, 3.0], *course_path()]
    assert judge(path, contacts_end=False, pushed_at=(5,)).finished


def test_the_arena_lies_around_all_frames():
    report = judge([[0.0, 0.0, 3.0], [300.0, 0.0, 3.0]])
    assert report.dnf_reason == "left the arena"
