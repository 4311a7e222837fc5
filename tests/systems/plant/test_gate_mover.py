import dataclasses as dc

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from airrace.systems.plant.gate_mover import PERIOD, GateMover
from airrace.track import Gate, Track, load_track

TRACK = load_track("student-airrace")
N = len(TRACK.gates)
MAX = 1.0


def watch(path, track=TRACK, seed=0, max_shift=MAX):
    """Shows the mover a path, one position a period; returns the shifts after each, (k, n, 2)."""
    mover = GateMover(track=track, max_shift=max_shift, seed=seed)
    simulator = Simulator(mover)
    context = simulator.get_mutable_context()
    rows = []
    for k, p in enumerate(path):
        mover.GetInputPort("state").FixValue(context, np.array([1, 0, 0, 0, *p] + [0.0] * 6))
        simulator.AdvanceTo((k + 0.5) * PERIOD)
        shifts = mover.GetOutputPort("gate_shifts").Eval(context)
        rows.append(shifts.reshape(-1, 2).copy())
    return np.array(rows)


def through(gates, side=0.0):
    """Two positions for each gate, before and behind it."""
    return [
        gate.p_WG + side * gate.rightward + step * gate.forward
        for gate in gates
        for step in (-2.0, 2.0)
    ]


def moves(rows):
    """Which gate moved at which position."""
    changed = np.any(np.diff(rows, axis=0, prepend=0 * rows[:1]), axis=2)
    return [(int(k), int(gate)) for k, gate in zip(*np.nonzero(changed))]


def test_a_gate_moves_half_a_lap_after_the_drone_has_passed_it():
    rows = watch(through(TRACK.gates * 3))
    behind = [2 * c + 1 for c in range(5, 3 * N)]  # the position behind the c-th gate
    assert moves(rows) == [(k, c % N) for c, k in enumerate(behind)]


def test_nothing_moves_before_it_was_passed():
    """Beside a gate, from behind, or out of order, the drone passes nothing."""
    gates = TRACK.gates
    assert moves(watch(through(gates, side=6.0))) == []
    assert moves(watch(through(gates)[::-1])) == []
    assert moves(watch(through(gates[1:]))) == []
    assert moves(watch([[0.0, 0.0, 5.0]] * 50)) == []


def test_a_gate_is_passed_where_it_stands_now():
    """The opening is 10 m wide: 4.8 m to a side is beside a gate that moved the other way."""
    first = watch(through(TRACK.gates))
    gate, shift = TRACK.gates[0], first[-1][0]
    aside = shift @ gate.rightward[:2]
    assert abs(aside) > 0.1
    ahead = through(TRACK.gates) + through([gate], side=aside + np.sign(aside) * 4.95)
    assert moves(watch(ahead))[-1] == (2 * N + 1, (N - 5) % N)  # inside
    missed = through(TRACK.gates) + through([gate], side=-np.sign(aside) * 4.95)
    assert moves(watch(missed))[-1][0] < 2 * N  # inside only where it was at first


def test_no_gate_moves_near_the_drone():
    """On a small triangle, the gate half a lap back is near: it waits for the drone to go."""
    gates = [
        Gate([x, y], heading)
        for x, y, heading in ((0.0, 5.0, 0.0), (11.0, 6.0, 120.0), (0.0, 15.0, 240.0))
    ]
    track = Track(name="small", gates=gates)
    path = through(gates[:2])
    near = watch(path, track)
    assert np.linalg.norm(path[-1] - gates[0].p_WG) < 20.0
    assert moves(near) == []
    away = [path[-1] + [15.0 * k, 0.0, 0.0] for k in range(4)]
    ((k, gate),) = moves(watch(path + away, track))
    assert gate == 0 and k > len(path)
    assert np.linalg.norm(np.array(path + away)[k, :2] - gates[0].p_WG[:2]) > 20.0


def test_places_are_uniform_and_no_step_is_longer_than_allowed():
    laps = 40
    for max_shift in (MAX, 0.25):
        shifts = watch(through(TRACK.gates * laps), max_shift=max_shift)[2 * N :: 2 * N]
        lengths = np.linalg.norm(shifts, axis=2)
        steps = np.linalg.norm(np.diff(shifts, axis=0), axis=2)
        for values in (lengths, steps):
            assert values.max() <= max_shift
            assert values.max() > 0.9 * max_shift
        assert steps.mean() > 0.4 * max_shift
        assert np.abs(shifts.mean(axis=(0, 1))).max() < 0.1 * max_shift


def test_the_seed_decides():
    path = through(TRACK.gates * 2)
    one, again, other = (watch(path, seed=seed)[-1] for seed in (1, 1, 2))
    assert one.tobytes() == again.tobytes()
    assert not np.any(one == other)


def test_all_is_in_the_context():
    """Updates by hand end where a simulator does."""
    mover = GateMover(track=TRACK, max_shift=MAX, seed=0)
    path = through(TRACK.gates * 2)
    expected = watch(path)[-1]
    context = mover.CreateDefaultContext()
    for p in path:
        mover.GetInputPort("state").FixValue(context, np.array([1, 0, 0, 0, *p] + [0.0] * 6))
        after = mover.EvalUniquePeriodicDiscreteUpdate(context)
        context.get_mutable_discrete_state().SetFrom(after)
    shifts = mover.GetOutputPort("gate_shifts").Eval(context)
    np.testing.assert_array_equal(shifts.reshape(-1, 2), expected)


@pytest.mark.parametrize("n", [3, 4, 5])
def test_small_tracks(n):
    """Far enough apart, every gate moves once between two passages."""
    gates = []
    for k in range(n):
        heading = 2 * np.pi * k / n
        rightward = np.array([np.sin(heading), -np.cos(heading)])
        middle = 60.0 * rightward
        gates.append(Gate((middle - 5.0 * rightward).tolist(), float(np.rad2deg(heading))))
    rows = watch(through(gates * 3), dc.replace(TRACK, gates=gates))
    for gate in range(n):
        passages = [2 * (gate + n * lap) for lap in range(3)]
        for a, b in zip(passages, passages[1:]):
            assert sum(a < k < b for k, g in moves(rows) if g == gate) == 1
