"""Laps planned in another process: the same ones, while everything else goes on."""

import contextlib
import dataclasses as dc
import os
import signal
import time

import numpy as np
import pytest

from airrace.common.errors import UserError
from airrace.hitl.planning_worker import PlanningWorker
from airrace.scenario import Scenario
from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.systems.planning.lap_planner import LapPlanner
from airrace.systems.planning.lap_planning import plan_lap
from airrace.track.gate_map import GateMap
from tests.systems.planning.test_lap_planner import Bench, moved
from tests.worlds.cases import first


def problem_and_scenario(**config):
    """Returns what a planner wants solved first."""
    asked = []
    bench = Bench("3", solve=lambda it: asked.append(it), **config)
    bench.plan_at(0.01)
    scenario = Scenario(trajectory="3")
    for name, value in config.items():
        setattr(scenario.planner, name, value)
    return asked[0], scenario


def solved(job, timeout=60.0):
    end = time.monotonic() + timeout
    while not job.done():
        assert time.monotonic() < end
        time.sleep(0.01)
    return job.result()


@pytest.mark.slow
@pytest.mark.parametrize(
    "config", first([{}, dict(lap="rest_to_rest", time_allocation="original")])
)
def test_the_same_plan_as_here_and_another_one_after_it(config):
    """And none of a worker that dies."""
    asked, scenario = problem_and_scenario(**config)
    here = plan_lap(asked)
    with contextlib.closing(PlanningWorker(scenario)) as worker:
        for _ in range(2):
            there = solved(worker.submit(asked))
            summary = dc.replace(there.summary, solve_time=here.summary.solve_time)
            assert summary == here.summary or dc.astuple(summary) == dc.astuple(here.summary)
            for part in ("entry", "circuit"):
                times = np.linspace(0.0, getattr(here, part).duration, 100)
                np.testing.assert_array_equal(
                    getattr(there, part).sample(times), getattr(here, part).sample(times)
                )
        job = worker.submit(asked)
        os.kill(worker._process.pid, signal.SIGKILL)
        assert solved(job) is None
        assert solved(worker.submit(asked)) is None


def find_nothing_sound(problem):
    return "a plan"


def make_careless(scenario):
    """A planner of one's own whose plans are none."""
    return LapPlanner.from_scenario(scenario, solve=find_nothing_sound)


def test_what_a_planner_of_ones_own_does_wrong_there_is_said_here():
    asked, scenario = problem_and_scenario()
    scenario.systems = {"lap_planner": f"{__name__}:make_careless"}
    with contextlib.closing(PlanningWorker(scenario)) as worker:
        job = worker.submit(asked)
        with pytest.raises(
            UserError, match=r"find_nothing_sound\(\) gave 'a plan' .*; it must give"
        ):
            solved(job)


class Job:
    """A search that ends when the test says so."""

    def __init__(self, plan):
        self.plan, self.is_done = plan, False

    def done(self):
        return self.is_done

    def result(self):
        return self.plan


@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize("moves", [False, True])
def test_a_planner_waits_without_blocking(late, moves):
    bench = Bench("3", update="always")  # also on the same map
    jobs = []

    def submit(asked):
        jobs.append(Job(plan_lap(asked)))
        return jobs[-1]

    bench.planner.solve_elsewhere(submit)
    assert bench.plan_at(0.3) is NO_PLAN and len(jobs) == 1
    if late:  # the first plan starts at rest: any time will do
        assert bench.plan_at(1.0) is NO_PLAN
    jobs[0].is_done = True
    plan = bench.plan_at(1.2)
    assert plan.lap == 1 and plan.start_time == pytest.approx(1.05 if late else 0.5, abs=0.06)
    if moves:
        bench.fix(gate_map=GateMap(gates=moved([0.3, 0.0, 0.0])))

    def next_job_takes(seconds):
        """Returns the plan in force when it is done, and half a lap later."""
        count = len(jobs)
        while len(jobs) == count:
            bench.plan_at(bench.context.get_time() + 0.1)
            assert bench.context.get_time() < 200.0
        bench.plan_at(bench.context.get_time() + seconds)
        jobs[-1].is_done = True
        assert jobs[-1].plan is not None
        return [
            bench.plan_at(bench.context.get_time() + wait)
            for wait in (0.1, plan.circuit.duration / 2)
        ]

    # One that comes too late to go on from is not flown: the old one is repeated.
    assert next_job_takes(3.0) == [plan, plan]
    # So the next is asked for earlier.
    before, after = next_job_takes(3.0)
    assert before is plan and after is jobs[-1].plan
