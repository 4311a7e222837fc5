"""The stopwatch: rows add up to the whole, and callers count without what they call."""

import time

import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import LeafSystem

from benchmarks.stopwatch import Stopwatch, watching


def busy(seconds):
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass


def seconds(stopwatch, name):
    return stopwatch.snapshot()[name][0]


def test_rows_exclude_each_other_and_add_up():
    stopwatch = Stopwatch("rest")
    start = time.process_time()
    inner = stopwatch.wrapped("inner", lambda: busy(0.02))

    def outer():
        busy(0.01)
        inner()

    stopwatch.wrapped("outer", outer)()
    busy(0.03)
    rows = stopwatch.snapshot()
    whole = time.process_time() - start
    assert sum(s for s, _ in rows.values()) == pytest.approx(whole, rel=0.05)
    for name, expected in (("inner", 0.02), ("outer", 0.01), ("rest", 0.03)):
        assert rows[name][0] == pytest.approx(expected, rel=0.2)
    assert [rows[name][1] for name in ("inner", "outer", "rest")] == [1, 1, 0]


def test_an_error_ends_the_row():
    stopwatch = Stopwatch("rest")

    def fail():
        raise KeyError

    with pytest.raises(KeyError):
        stopwatch.wrapped("fails", fail)()
    before = seconds(stopwatch, "fails")
    busy(0.01)
    assert seconds(stopwatch, "fails") == before


class Slow(LeafSystem):
    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareDiscreteState(1)
        self.DeclarePeriodicDiscreteUpdateEvent(0.1, 0.0, self._update)
        self.DeclareVectorOutputPort("y", 1, self._calc_y)

    def _update(self, context, discrete_state):
        busy(0.002)

    def _calc_y(self, context, output):
        busy(0.002)


def test_systems_made_under_watch_have_a_row():
    stopwatch = Stopwatch("rest")
    declare = LeafSystem.DeclareVectorOutputPort
    with watching(stopwatch, {}):
        watched = Slow()
    assert LeafSystem.DeclareVectorOutputPort is declare
    simulator = Simulator(watched)
    simulator.AdvanceTo(0.95)
    watched.GetOutputPort("y").Eval(simulator.get_context())
    spent, calls = stopwatch.snapshot()["Slow"]
    assert calls == 11
    assert spent == pytest.approx(0.022, rel=0.3)
