"""Whether a computer is fast enough, in words."""

import os

import numpy as np
import pytest

from airrace.common.errors import UserError
from airrace.hitl.budget import Budget, prepare_halves
from airrace.hitl.handover import Compiling, Playing, Warm
from airrace.hitl.navigator_process import NavigatorProcess
from airrace.scenario import Scenario

REMEDY = "end other programs, or race with --realtime_rate"


@pytest.mark.parametrize(
    "budget, rate, words",
    [
        (Budget(0.2, 0.6, 1e-3, 4), 1.0, "real time with 40 % to spare"),
        (Budget(0.6, 0.2, 1e-3, 2), 1.0, "real time with 40 % to spare"),
        (Budget(0.1, 0.5, 1e-3, 1), 1.0, "real time with 40 % to spare"),
        (
            Budget(0.2, 0.9, 1e-3, 4),
            1.0,
            f"real time leaves no reserve for this computer: {REMEDY} 0.8",
        ),
        (Budget(0.4, 1.5, 1e-3, 4), 1.0, f"real time is too much for this computer: {REMEDY} 0.5"),
        (Budget(0.4, 1.2, 1e-3, 4), 0.5, "0.5 x real time with 40 % to spare"),
        (
            Budget(0.4, 4.0, 1e-3, 4),
            0.5,
            f"--realtime_rate 0.5 is too much for this computer: {REMEDY} 0.2",
        ),
    ],
)
def test_what_it_says(budget, rate, words):
    assert budget.verdict(rate) == words


def test_the_advice_leaves_a_reserve_if_any_rate_does():
    for needed in (0.1, 0.79, 0.81, 1.0, 3.0, 15.0, 100.0):
        rate = Budget(0.0, needed, 0.0, 2).rate
        assert rate * needed <= 0.8 or rate == 0.05


@pytest.mark.slow
def test_both_halves_fly_at_once(tmp_path):
    navigator = NavigatorProcess(
        Scenario(), "udpm://239.255.76.67:7667?ttl=0", tmp_path, duration=0.5
    )
    try:
        budget = prepare_halves(Scenario(), navigator, 0.5)
    finally:
        navigator.close()
    assert 0.0 < budget.pilot < 20.0 and 0.0 < budget.navigator < 20.0
    assert 1e-5 < budget.tick < 1.0 and 1 <= budget.processors <= os.cpu_count()


class QuickNavigator:
    """Is warm before the pilot is: all that it says waits when that looks for the first time."""

    def __init__(self):
        self.says = [Compiling(7), Playing(), Warm(0.3)]

    def receive(self):
        said, self.says = self.says, []
        return said

    def poll(self):
        return None


def test_a_navigator_may_be_ready_first(monkeypatch):
    shown = []
    monkeypatch.setattr("airrace.hitl.budget.warm_up_pilot", lambda scenario, briefly: None)
    monkeypatch.setattr("airrace.hitl.budget.play_pilot", lambda *_: np.full(10, 1e-3))
    budget = prepare_halves(Scenario(), QuickNavigator(), 0.5, show=shown.append, poll=pytest.fail)
    assert budget.navigator == 0.3 and shown == [7]


@pytest.mark.slow
def test_a_navigator_that_cannot_begin_says_why(tmp_path):
    scenario = Scenario(systems={"explorer": "nobody:here"})
    navigator = NavigatorProcess(scenario, "", tmp_path, duration=0.5)
    try:
        with pytest.raises(UserError, match="systems.explorer: 'nobody:here' cannot be imported"):
            prepare_halves(Scenario(), navigator, 0.5)
    finally:
        navigator.close()
