import time

import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.primitives import ConstantVectorSource

from airrace.visualization.controls import PAUSE, SPEED, RaceControls
from tests.visualization.meshcat_tools import click, slide


@pytest.fixture
def simulator():
    return Simulator(ConstantVectorSource([1.0]))


def test_the_slider_sets_the_rate(meshcat, simulator):
    controls = RaceControls(meshcat, simulator)
    controls.steer()
    assert simulator.get_target_realtime_rate() == 0.0
    slide(meshcat, SPEED, 2.5)
    controls.steer()
    assert simulator.get_target_realtime_rate() == 2.5


def test_a_rate_that_nobody_changes_stays_as_it_is(meshcat, simulator):
    simulator.set_target_realtime_rate(0.3)  # between two steps of the slider
    controls = RaceControls(meshcat, simulator)
    controls.steer()
    assert simulator.get_target_realtime_rate() == 0.3


def test_the_race_stands_still_until_the_second_click(meshcat, simulator, monkeypatch):
    controls = RaceControls(meshcat, simulator)
    naps = []

    def nap(seconds):
        naps.append(seconds)
        if len(naps) == 3:
            click(meshcat, PAUSE)

    monkeypatch.setattr(time, "sleep", nap)
    click(meshcat, PAUSE)
    controls.steer()
    assert len(naps) == 3
    controls.steer()
    assert len(naps) == 3


def test_a_paused_race_can_be_interrupted(meshcat, simulator):
    controls = RaceControls(meshcat, simulator)
    click(meshcat, PAUSE)
    controls.steer(interrupted=lambda: True)


def test_a_second_race_on_the_same_page(meshcat, simulator):
    RaceControls(meshcat, simulator)
    RaceControls(meshcat, simulator).steer()
