import time

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator
from pydrake.systems.primitives import ConstantVectorSource

from airrace.visualization.controls import MAX_RATE, Pace, PaceRequest, RaceControls
from tests.worlds.cases import guarded


@pytest.fixture
def simulator():
    return Simulator(ConstantVectorSource([1.0]))


@pytest.fixture
def pace():
    return PaceRequest()


def test_a_request_sets_the_rate(pace, simulator):
    controls = RaceControls(pace, simulator)
    controls.steer()
    assert simulator.get_target_realtime_rate() == 0.0
    pace.receive({"rate": 2.5})
    controls.steer()
    assert simulator.get_target_realtime_rate() == 2.5


def test_a_rate_that_nobody_changes_stays_as_it_is(pace, simulator):
    simulator.set_target_realtime_rate(0.3)
    controls = RaceControls(pace, simulator)
    controls.steer()
    assert simulator.get_target_realtime_rate() == 0.3


def test_the_race_stands_still_until_it_may_go_on(pace, simulator, monkeypatch):
    controls = RaceControls(pace, simulator)
    naps = []

    def nap(seconds):
        naps.append(seconds)
        if len(naps) == 3:
            pace.receive({"pause": False})

    monkeypatch.setattr(time, "sleep", nap)
    pace.receive({"pause": True})
    controls.steer()
    assert len(naps) == 3
    controls.steer()
    assert len(naps) == 3


def test_a_paused_race_can_be_interrupted(pace, simulator):
    controls = RaceControls(pace, simulator)
    pace.receive({"pause": True})
    controls.steer(interrupted=lambda: True)


def test_nothing_can_be_asked_of_a_race_that_keeps_its_own_time(pace):
    pace.receive({"pause": True})
    assert pace.now is None
    pace.begin(1.0)
    pace.end()
    pace.receive({"pause": True})
    assert pace.now is None


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(),
    lambda each: st.lists(each) | st.dictionaries(st.sampled_from(["pause", "rate"]), each),
)


@guarded
@given(ANYTHING)
def test_whatever_a_page_sends_is_a_sensible_request(message):
    pace = PaceRequest()
    pace.begin(1.0)
    pace.receive(message)
    paused, rate = pace.now
    assert isinstance(pace.now, Pace) and type(paused) is bool and type(rate) is float
    assert 0.0 <= rate <= MAX_RATE
