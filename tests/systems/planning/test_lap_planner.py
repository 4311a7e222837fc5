"""The lap planner alone: its inputs fixed, its plans checked."""

import dataclasses as dc
import functools
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator

from airrace.common.errors import UserError
from airrace.scenario import PlannerConfig, Scenario
from airrace.systems.planning.lap_plan import NO_PLAN, LapPlan, PlanSummary
from airrace.systems.planning.lap_planner import LapPlanner
from airrace.systems.planning.lap_planning import plan_lap
from airrace.systems.planning.map_margins import CONTROLLER, pylon_margins
from airrace.systems.types import ExplorerEvent, ExplorerStatus
from airrace.track import load_track
from airrace.track.gate_map import GateEstimate, GateMap, MarkerEstimate
from airrace.track.generator import generate_track
from airrace.track.map_files import true_map
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.feasibility import clearance_of
from airrace.trajopt.flat_trajectory import hold
from airrace.trajopt.flatness import inverse_dynamics
from airrace.trajopt.flight_limits import FlightConstraints, FlightLimits
from airrace.trajopt.min_snap.circuit import LapStyle, plan_circuit
from airrace.trajopt.min_snap.transition import (
    plan_transition_between_laps,
    plan_transition_from_hover,
)
from airrace.trajopt.reference import as_reference
from airrace.vehicle import GRAVITY, RACERS, load_vehicle
from airrace.vehicle.state import STATE_SIZE
from tests.worlds import cases

VEHICLE, _ = load_vehicle("Default")
CLEARANCE = clearance_of(VEHICLE.radius)
LIMITS = FlightLimits(VEHICLE, max_speed=20.0, max_acceleration=10.0)
GATES = tuple(
    GateEstimate(number=n, p_WG=gate.p_WG, heading=gate.heading, spacing=gate.pylon_spacing)
    for n, gate in enumerate(load_track("student-airrace").gates)
)
DONE = ExplorerStatus(state="DONE", gates=tuple(range(10)), done=True)
few = settings(max_examples=30)


def moved(step):
    """Returns the gates, all of them moved by (3,) m."""
    return tuple(dc.replace(gate, p_WG=gate.p_WG + step) for gate in GATES)


class Bench:
    """A LapPlanner whose inputs are constants that a test may change."""

    def __init__(
        self,
        trajectory="3",
        gates=GATES,
        status=DONE,
        solve=plan_lap,
        laps=np.inf,
        least_margin=CONTROLLER,
        **config,
    ):
        config = PlannerConfig(**{"latency": 0.5, "first_lap_move": 0.05} | config)
        self.problems = []  # that it was given to solve

        def noted(problem):
            self.problems.append(problem)
            return solve(problem)

        self.planner = LapPlanner(
            vehicle=VEHICLE,
            trajectory=str(trajectory),
            config=config,
            laps=laps,
            solve=noted,
            least_margin=least_margin,
        )
        self.simulator = Simulator(self.planner)
        self.context = self.simulator.get_mutable_context()
        self.fix(gate_map=GateMap(gates=gates), explorer_status=status)
        self.planner.GetInputPort("exploration_reference").FixValue(
            self.context, hold([0, 0, 5], 0.0)
        )
        self.simulator.Initialize()

    def fix(self, **inputs):
        for name, value in inputs.items():
            self.planner.GetInputPort(name).FixValue(self.context, Value[object](value))

    def plan_at(self, time) -> LapPlan:
        self.simulator.AdvanceTo(time)
        return self.planner.GetOutputPort("lap_plan").Eval(self.context)

    def follow(self, until, every=0.05):
        """Returns the plans up to a time and when each was first seen."""
        plans, times = [], []
        for time in np.arange(self.context.get_time() + every, until, every):
            plan = self.plan_at(time)
            if plan is not NO_PLAN and (not plans or plan is not plans[-1]):
                plans.append(plan)
                times.append(time)
        return plans, times


@pytest.mark.slow
def test_optimal_laps_are_faster_and_within_the_limits_and_followed_by_the_next():
    bench = Bench("optimal")
    plans = [bench.plan_at(1.0)]
    bench.fix(gate_map=GateMap(gates=moved([0.0, 0.1, 0.0])))
    plans += bench.follow(until=30.0, every=0.5)[0][1:]
    assert [plan.lap for plan in plans] == [1, 2]
    snap = plan_circuit(
        [g.p_WG for g in GATES],
        [g.heading for g in GATES],
        4,
        FlightConstraints(np.array([g.pylons for g in GATES]).reshape(-1, 2), CLEARANCE, LIMITS),
    )
    for plan in plans:
        assert plan.summary.duration < 0.9 * snap.duration
        assert plan.summary.max_speed <= 20.0 and plan.summary.max_acceleration <= 10.0
        # It goes on from where the one before ends, and onto its own lap.
        t = plan.start_time + plan.entry.duration
        np.testing.assert_allclose(
            plan.derivatives(t - 1e-7)[:4, :3], plan.derivatives(t + 1e-7)[:4, :3], atol=1e-3
        )
    t = plans[1].start_time
    np.testing.assert_allclose(
        plans[0].derivatives(t)[:4, :3], plans[1].derivatives(t)[:4, :3], atol=1e-3
    )


def test_ticks_at_which_nothing_happens_change_nothing():
    """To Drake, every other update changes all that any system computes."""
    bench = Bench(laps=2, update="always")
    plans, _ = bench.follow(until=100.0, every=0.5)
    # Each plan is found, and comes into force.
    assert bench.simulator.get_num_unrestricted_updates() == 2 * len(plans) == 4


def test_no_plan_for_after_the_race():
    bench = Bench(laps=2, update="always")
    plans, _ = bench.follow(until=100.0, every=0.5)
    assert [plan.lap for plan in plans] == [1, 2] and len(bench.problems) == 2


def test_no_plan_before_the_exploration_is_done():
    bench = Bench(status=dc.replace(DONE, done=False))
    assert bench.plan_at(5.01) is NO_PLAN
    bench.fix(explorer_status=DONE)
    assert bench.plan_at(5.54) is NO_PLAN
    plan = bench.plan_at(5.56)
    assert plan.lap == 1 and plan.start_time == pytest.approx(5.55)
    np.testing.assert_allclose(plan.derivatives(5.55)[0], [0, 0, 5, 0], atol=1e-9)
    np.testing.assert_allclose(plan.derivatives(5.55)[1:4], 0.0, atol=1e-9)


@pytest.mark.slow
@settings(max_examples=6)
@given(st.floats(0.01, 2.0), st.floats(2.0, 50.0))
def test_plans_come_into_force_exactly_one_latency_later(latency, rate):
    bench = Bench(latency=latency, rate=rate, update="always")
    assert bench.plan_at(latency - 1e-6) is NO_PLAN
    first = bench.plan_at(latency + 1e-6)
    assert first.start_time == pytest.approx(latency, abs=1e-12)
    # The next one: at the first tick after the last gate less the latency.
    lap = first.circuit.duration
    first_gate = first.next_start(latency + first.entry.duration) - lap
    last_gate = first_gate + first.circuit.gate_times[-2]
    bench.simulator.AdvanceTo(last_gate - 0.01)
    for _ in range(60):
        second = bench.plan_at(bench.context.get_time() + 0.01)
        if second is not first:
            break
    assert -1e-6 <= second.start_time - last_gate <= 1.0 / rate + 1e-6
    assert bench.context.get_time() - 0.01 <= second.start_time <= bench.context.get_time() + 1e-9
    ticks = (second.start_time - latency) * rate
    assert ticks == pytest.approx(round(ticks), abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("dimensions", cases.first([4, 3, 6]))
def test_a_plan_a_lap_from_the_map_as_it_then_stands(dimensions):
    bench = Bench(dimensions)
    lap = bench.plan_at(1.0).circuit.duration
    steps = [np.array([0.1 * k, -0.05 * k, 0.02 * k]) for k in range(4)]
    plans = [bench.plan_at(1.0)]
    for step in steps[1:]:
        bench.fix(gate_map=GateMap(gates=moved(step)))
        new, times = bench.follow(bench.context.get_time() + lap)
        assert new[0] is plans[-1] and len(new) == 2
        plans.append(new[-1])
    assert [plan.lap for plan in plans] == [1, 2, 3, 4]
    for plan, step in zip(plans, steps):
        gate_1 = plan.circuit.derivatives(0.0)[0, :3]
        np.testing.assert_allclose(gate_1, GATES[0].p_WG + step, atol=1e-8)
        expected = plan_circuit(
            [g.p_WG for g in moved(step)],
            [g.heading for g in GATES],
            dimensions,
            FlightConstraints([p for g in moved(step) for p in g.pylons], CLEARANCE, LIMITS),
        )
        tolerance = 1e-4 if dimensions < 6 else 0.03  # of many local minima
        assert plan.circuit.duration == pytest.approx(expected.duration, rel=tolerance)
    for old, new in zip(plans, plans[1:]):
        # Right after the last gate, less than one tick, and without a jump.
        since = (new.start_time - old.next_start(new.start_time)) + lap - old.circuit.gate_times[-2]
        assert -1e-3 < since < 0.05 + 1e-3
        handed = new.derivatives(new.start_time) - old.derivatives(new.start_time)
        handed[0, 3] = np.sin(handed[0, 3] / 2)
        np.testing.assert_allclose(handed, 0.0, atol=1e-6)
        assert new.lap_at(new.start_time) == old.lap_at(new.start_time) == old.lap
        assert new.phase == 0.0


@pytest.mark.parametrize("x", cases.first([-30, -400, -60, -100], 2))
def test_an_entry_is_not_replanned(x):
    """Not even one longer than a lap: only the lap behind it has a last gate."""
    bench = Bench(update="always")
    bench.planner.GetInputPort("exploration_reference").FixValue(
        bench.context, hold([x, 0, 5], 0.0)
    )
    first = bench.plan_at(1.0)
    joined = first.start_time + first.entry.duration
    lap = first.circuit.duration
    assert bench.follow(joined - first.phase + 0.85 * lap)[0] == [first]
    plans, _ = bench.follow(bench.context.get_time() + 0.15 * lap)
    assert [plan.lap for plan in plans] == [1, 2]


UNUSABLE = {
    "no gates": (),
    "one gate": GATES[:1],
    "a gap": (*GATES[:4], *GATES[5:]),
    "gates on the ground": moved([0.0, 0.0, -6.0]),
    "gates in one place": tuple(dc.replace(g, p_WG=GATES[0].p_WG) for g in GATES),
    "not a number": (*GATES[:9], dc.replace(GATES[9], heading=np.nan)),
    "gates as narrow as a drone": tuple(dc.replace(g, spacing=3.5) for g in GATES),
}


@pytest.mark.parametrize("fault", cases.first(UNUSABLE, 6))
def test_without_a_usable_map_it_tries_again(fault):
    gates = UNUSABLE[fault]
    bench = Bench(gates=gates)
    assert bench.plan_at(2.6) is NO_PLAN
    bench.fix(gate_map=GateMap(gates=GATES))
    # It looks once a second.
    assert bench.plan_at(4.1 + 0.5).lap == 1


def test_what_gave_no_plan_is_not_tried_again_until_the_map_has_changed():
    bench = Bench(solve=lambda problem: None)
    tried = bench.problems
    bench.plan_at(5.0)
    assert len(tried) == 1
    bench.fix(gate_map=GateMap(gates=moved([0.005, 0.0, 0.0])))
    bench.plan_at(8.0)
    assert len(tried) == 1
    bench.fix(gate_map=GateMap(gates=moved([0.3, 0.0, 0.0])))
    bench.plan_at(20.0)
    assert len(tried) == 2
    np.testing.assert_array_equal(tried[1].gates[0].p_WG, GATES[0].p_WG + [0.3, 0.0, 0.0])
    assert tried[1].old is NO_PLAN and tried[1].start.shape == (5, 4)


def test_it_does_not_search_twice_for_a_lap_through_the_same_gates():
    bench = Bench()
    plans, _ = bench.follow(110.0, every=0.5)
    assert plans[-1].lap_at(110.0) >= 4
    first, second = bench.problems
    assert first.old is NO_PLAN and second.old is plans[0]
    bench.fix(gate_map=GateMap(gates=moved([0.001, 0.0, 0.0])))
    bench.follow(200.0, every=0.5)
    assert len(bench.problems) == 3
    assert dc.replace(second, old=plans[-1], start_time=9.0).has_same_lap(second)
    for other in (
        dict(gates=second.gates[1:] + second.gates[:1]),
        dict(margins=second.margins + 1e-9),
        dict(gates=moved([0.0, 0.0, 1e-9])),
        dict(pylons=second.pylons[:-2]),
    ):
        assert not dc.replace(second, **other).has_same_lap(second)


def test_always_a_new_plan_even_on_the_same_map():
    bench = Bench(update="always", lap="rest_to_rest", time_allocation="original")
    plans, _ = bench.follow(160.0, every=0.5)
    assert [plan.lap for plan in plans] == [1, 2, 3, 4]
    assert len(bench.problems) == 4
    for problem in bench.problems:
        assert problem.always and problem.style == LapStyle(rests=True, soft=True)
    # Each is in force when the lap before it ends, at rest.
    for old, new in zip(plans, plans[1:]):
        assert old.next_start(new.start_time) == pytest.approx(
            new.start_time + new.entry.duration, abs=0.2
        )
        end = new.start_time + new.entry.duration
        np.testing.assert_allclose(new.derivatives(end)[1:], 0.0, atol=1e-4)


def test_what_the_scenario_says_of_laps_reaches_the_problem():
    bench = Bench(solve=lambda problem: None)
    bench.plan_at(1.0)
    (problem,) = bench.problems
    assert problem.style == LapStyle() and not problem.always
    for config, style in (
        (dict(lap="rest_to_rest"), LapStyle(rests=True)),
        (dict(time_allocation="original"), LapStyle(soft=True)),
    ):
        bench = Bench(solve=lambda problem: None, **config)
        bench.plan_at(1.0)
        assert bench.problems[0].style == style


def test_the_problem_says_how_well_pylons_are_known_and_starts_on_the_old_lap():
    def known(sigma):
        return tuple(
            MarkerEstimate(
                id=id,
                count=9,
                outliers=0,
                p_WM=np.zeros(3),
                normal=np.eye(3)[0],
                variance=np.full(3, sigma**2),
            )
            for id in range(40)
        )

    bench = Bench()
    problems = bench.problems
    bench.fix(gate_map=GateMap(gates=GATES, markers=known(0.1)))
    first = bench.plan_at(1.0)
    bench.fix(gate_map=GateMap(gates=moved([0.0, 0.05, 0.0]), markers=known(0.01)))
    bench.follow(1.0 + 1.2 * first.circuit.duration)
    assert len(problems) == 2
    for problem, sigma in zip(problems, (0.1, 0.01)):
        np.testing.assert_allclose(problem.margins, problems[1].margins[0] + 3 * (sigma - 0.01))
        assert problem.pylons.shape == (20, 2) and len(problem.margins) == 20
    assert problems[1].old is first
    np.testing.assert_array_equal(problems[1].start, first.derivatives(problems[1].start_time))


def test_the_first_lap_expects_gates_that_move():
    bench = Bench(first_lap_move=0.8)
    problems = bench.problems
    first = bench.plan_at(1.0)
    bench.fix(gate_map=GateMap(gates=moved([0.0, 0.05, 0.0])))  # as a better map would be
    bench.follow(1.0 + 1.2 * first.circuit.duration)
    still = pylon_margins(GATES, ())
    np.testing.assert_allclose(problems[0].margins, still + 0.8)
    np.testing.assert_array_equal(problems[1].margins, still)


def test_margins_follow_from_how_the_drone_follows_at_each_gate():
    bench = Bench(update="always", least_margin=0.15)
    for tick in itertools.count(20):
        now = tick / 20
        plan = bench.plan_at(now)
        if len(bench.problems) == 2:
            break
        estimate = np.zeros(STATE_SIZE)
        position, velocity = plan.derivatives(now)[:2, :3]
        off = 0.2 if plan.nearest_gate(now) == 3 else 0.0
        side = np.cross(velocity, [0.0, 0.0, 1.0])
        # Everywhere late; that makes no margin.
        estimate[5:8] = position - 0.05 * velocity + off * side / max(np.linalg.norm(side), 1e-9)
        bench.planner.GetInputPort("filtered_estimate").FixValue(bench.context, estimate)
    first, second = (problem.margins[: 2 * len(GATES)] for problem in bench.problems)
    np.testing.assert_array_equal(first, CONTROLLER)
    expected = np.full(2 * len(GATES), 0.15)
    expected[6:8] = 0.7
    np.testing.assert_allclose(second, expected, atol=0.05 + 1e-9)


@pytest.mark.parametrize(
    ("estimator", "limits", "nearer"),
    [("truth", "rotor", True), ("vio", "rotor", False), ("truth", "original", False)],
)
def test_only_a_drone_that_is_told_where_it_is_comes_nearer(estimator, limits, nearer):
    scenario = Scenario(estimator=estimator, planner=PlannerConfig(limits=limits))
    assert (LapPlanner.from_scenario(scenario)._least_margin < CONTROLLER) == nearer


@pytest.mark.parametrize("drone", RACERS)
@pytest.mark.parametrize("share", [None, 0.9])
def test_betaflight_keeps_what_the_drones_file_says(drone, share):
    config = PlannerConfig(limits="rotor", thrust_share=share)
    scenario = Scenario(drone=drone, flight_controller="betaflight", planner=config)
    own = load_vehicle(drone)[0].betaflight_share
    assert LapPlanner.from_scenario(scenario)._limits.thrust_share == (share or own)
    internal = dc.replace(scenario, flight_controller="internal")
    assert LapPlanner.from_scenario(internal)._limits.thrust_share == (share or 1.0)


def test_margins_of_a_flight_controllers_drone_stay():
    """Each new lap at the limits is one that it follows worse than the one before."""
    scenario = Scenario(flight_controller="betaflight", planner=PlannerConfig(limits="rotor"))
    assert LapPlanner.from_scenario(scenario)._least_margin is None
    bench = Bench(update="always", least_margin=None)
    for tick in itertools.count(20):
        now = tick / 20
        plan = bench.plan_at(now)
        if len(bench.problems) == 2:
            break
        estimate = np.zeros(STATE_SIZE)
        estimate[5:8] = plan.derivatives(now)[0, :3] + [0.5, 0.5, 0.0]
        bench.planner.GetInputPort("filtered_estimate").FixValue(bench.context, estimate)
    for problem in bench.problems:
        np.testing.assert_array_equal(problem.margins[: 2 * len(GATES)], CONTROLLER)


@pytest.mark.parametrize(
    "limits, flown, share",
    [("rotor", "HOVER", 0.5), ("rotor", "RETURN", 0.0), ("original", "HOVER", 0.0)],
)
def test_a_drone_that_only_hovered_counts_with_drag_on_its_first_lap(limits, flown, share):
    events = tuple(ExplorerEvent(0.0, state, "") for state in ("TAKE_OFF", flown, "DONE"))
    status = dc.replace(DONE, events=events)
    bench = Bench(status=status, limits=limits, first_lap_drag=0.5, solve=lambda problem: None)
    bench.plan_at(0.1)
    (problem,) = bench.problems
    kept = 1.0 - problem.limits.vehicle.max_thrusts.sum() / VEHICLE.max_thrusts.sum()
    assert kept == pytest.approx(0.3 * share)
    drag = np.array(VEHICLE.drag.quadratic) / VEHICLE.mass
    np.testing.assert_allclose(
        problem.air[[1, -1]], [share * drag[0], share * (drag[2] - drag[0])], atol=1e-9
    )


@pytest.mark.slow
def test_plans_turn_no_quicker_than_the_rotors_follow():
    """This lap would turn with 16.7 rad/s, and the drone would be 0.6 m off it afterwards."""
    bench = Bench("optimal", gates=true_map(generate_track(4)).gates, limits="rotor")
    assert 11.0 < bench.plan_at(0.6).summary.max_rate <= 12.0


def test_a_drone_that_cannot_hover_within_the_limits_is_refused():
    """Laps keep a little of the thrust, so just as much as a hover takes is too little."""
    hover = VEHICLE.mass * GRAVITY / VEHICLE.max_thrusts.sum()
    for share in (0.2, 1.001 * hover, 1.015 * hover):
        with pytest.raises(TrajectoryOptimizationError, match="cannot hold a hover"):
            Bench(thrust_share=share)
    Bench(thrust_share=1.03 * hover)


def test_a_drone_that_lifts_off_with_idle_rotors_is_refused():
    strong = VEHICLE.with_thrusts(np.full(4, 1e3))
    with pytest.raises(TrajectoryOptimizationError, match="lift more than its weight"):
        FlightLimits(strong).scaled(0.98).check()


@pytest.mark.parametrize(
    ("share", "remedy"),
    [(None, "Change the drone"), (1.0, "Change the drone"), (0.9, "Raise planner")],
)
def test_a_drone_whose_rotors_cannot_lift_it_is_told_what_to_change(share, remedy, monkeypatch):
    """One of its rotors is weak: together they could."""
    weak = VEHICLE.with_thrusts([0.25, 1.0, 1.0, 1.0])
    assert weak.max_thrusts.sum() > weak.mass * GRAVITY
    monkeypatch.setattr(
        "airrace.systems.planning.lap_planner.load_vehicle", lambda name: (weak, None)
    )
    with pytest.raises(UserError, match=f"cannot hold a hover. {remedy}"):
        LapPlanner.from_scenario(Scenario(planner=PlannerConfig(thrust_share=share)))


@pytest.mark.slow
@pytest.mark.parametrize("fault", cases.first(UNUSABLE, 2))
def test_without_a_usable_map_the_old_plan_goes_on(fault):
    gates = UNUSABLE[fault]
    bench = Bench()
    first = bench.plan_at(1.0)
    bench.fix(gate_map=GateMap(gates=gates))
    lap = first.circuit.duration
    assert bench.follow(1.0 + 1.5 * lap)[0] == [first]
    assert first.lap_at(bench.context.get_time()) == 2
    bench.fix(gate_map=GateMap(gates=moved([0.1, 0, 0])))
    plans, _ = bench.follow(1.0 + 2.5 * lap)
    assert [plan.lap for plan in plans] == [1, 3]


def test_a_map_that_jumps_is_left_for_the_next_lap():
    """No flight leads from the old last leg to a gate 1 so far away."""
    bench = Bench()
    first = bench.plan_at(1.0)
    bench.fix(gate_map=GateMap(gates=moved([0, 15.0, 0])))
    assert bench.follow(1.0 + 1.3 * first.circuit.duration)[0] == [first]


def test_gates_that_the_explorer_did_not_find_are_avoided_but_not_flown_through():
    stray = dc.replace(GATES[0], number=14, p_WG=np.array([0.0, 20.0, 6.25]))
    plan = Bench(gates=(*GATES, stray)).plan_at(1.0)
    assert len(plan.circuit.gate_times) == 11
    assert plan.circuit.duration == pytest.approx(Bench().plan_at(1.0).circuit.duration, rel=1e-6)
    # In the way of the lap, it leaves none.
    on_the_way = plan.circuit.derivatives(plan.circuit.duration / 2)[0, :3]
    stray = dc.replace(stray, p_WG=on_the_way + [0, 5, 0], heading=np.pi)
    assert Bench(gates=(*GATES, stray)).plan_at(1.0) is NO_PLAN


SQUARE = tuple(
    GateEstimate(number=n, p_WG=np.array([x, y, 6.0]), heading=n * np.pi / 2, spacing=10.0)
    for n, (x, y) in enumerate([(20, 0), (40, 20), (20, 40), (0, 20)])
)


@pytest.mark.slow
@pytest.mark.parametrize("rate, latency", cases.first([(0.45, 3.0), (0.3, 0.5), (20.0, 30.0)]))
@pytest.mark.parametrize("gates", [GATES, SQUARE], ids=["reference", "square"])
def test_a_slow_planner_never_skips_a_gate(gates, rate, latency):
    status = dc.replace(DONE, gates=tuple(range(len(gates))))
    bench = Bench(gates=gates, status=status, rate=rate, latency=latency)
    plans = []
    for k in range(5):  # the track gets smaller, so that there are quicker laps
        smaller = tuple(dc.replace(gate, p_WG=0.999**k * gate.p_WG) for gate in gates)
        bench.fix(gate_map=GateMap(gates=smaller))
        seen = bench.follow(bench.context.get_time() + latency + 40.0, every=0.25)[0]
        plans += [plan for plan in seen if not plans or plan is not plans[-1]]
    assert len(plans) >= 4  # so slow a planner finds them all the same
    for old, new in zip(plans, plans[1:]):
        assert new.start_time >= old.start_time + old.entry.duration
        left = old.next_start(new.start_time) - new.start_time
        assert 0 < left <= old.circuit.duration - old.circuit.gate_times[-2] + 1e-6
        assert new.lap == old.lap_at(new.start_time) + 1


@pytest.mark.slow
@pytest.mark.parametrize("dimensions", [3, 6])
def test_the_report_is_true(dimensions):
    bench = Bench(dimensions)
    first = bench.plan_at(1.0)
    bench.fix(gate_map=GateMap(gates=moved([0.2, 0.1, 0])))
    second = bench.follow(1.0 + 1.2 * first.circuit.duration)[0][-1]
    assert second.lap == 2
    for plan in (first, second):
        samples = np.hstack(
            [
                part.sample(np.linspace(0, part.duration, int(1000 * part.duration)))
                for part in (plan.entry, plan.circuit)
            ]
        )
        summary = plan.summary
        assert summary.duration == plan.circuit.duration
        assert summary.max_speed == pytest.approx(
            np.linalg.norm(as_reference(samples).velocity, axis=0).max(), rel=1e-3
        )
        assert summary.max_acceleration == pytest.approx(
            np.linalg.norm(as_reference(samples).acceleration, axis=0).max(), rel=1e-3
        )
        thrusts = inverse_dynamics(samples, VEHICLE)[0]
        assert summary.max_rotor_thrust == pytest.approx(thrusts.max(), rel=0.01)
        assert summary.max_speed <= 20.0 and summary.max_acceleration <= 10.0
        assert thrusts.min() > 0.0 and summary.max_rotor_thrust < VEHICLE.max_thrusts.min()
        assert 0.0 < summary.solve_time < 20.0


@pytest.mark.slow
def test_two_runs_are_the_same():
    one, other = (Bench(6).plan_at(1.0) for _ in range(2))
    for t in np.linspace(0.5, 60.0, 20):
        np.testing.assert_array_equal(one.derivatives(t), other.derivatives(t))


# The plan itself.


@functools.cache
def make_plan(dimensions, phase_zero):
    circuit = plan_circuit(
        [g.p_WG for g in GATES],
        [g.heading for g in GATES],
        dimensions,
        FlightConstraints([p for g in GATES for p in g.pylons], CLEARANCE, LIMITS),
    )
    free = FlightConstraints([], CLEARANCE, LIMITS)
    if phase_zero:
        at = circuit.gate_times[-2]
        start, phase = circuit.derivatives(at), 0.0
        entry = plan_transition_between_laps(start, circuit, circuit.duration - at, free)
    else:
        start = np.zeros((5, 4))
        start[0] = 0, 0, 5, 0.5
        entry, phase = plan_transition_from_hover(start, circuit, dimensions, free)
    return LapPlan(
        lap=3, start_time=12.5, entry=entry, circuit=circuit, phase=phase, summary=PlanSummary()
    )


plans = st.builds(make_plan, st.sampled_from([3, 4, 6]), st.booleans())
times = st.floats(12.5, 200.0)


def seams(plan):
    """Returns when the plan goes from one polynomial to another."""
    on = plan.start_time + plan.entry.duration
    return [on] + [on - plan.phase + k * plan.circuit.duration for k in range(1, 4)]


@pytest.mark.slow
@few
@given(plans)
def test_a_plan_has_no_seams(plan):
    for t in seams(plan):
        jump = plan.derivatives(t + 1e-9) - plan.derivatives(t - 1e-9)
        jump[0, 3] = np.sin(jump[0, 3] / 2)
        # The first entry's snap is free.
        np.testing.assert_allclose(jump[:4], 0.0, atol=1e-4)
        if plan.phase == 0.0 or t > seams(plan)[0]:
            np.testing.assert_allclose(jump[4], 0.0, atol=1e-4)


@pytest.mark.slow
@few
@given(plans, times, st.integers(1, 3))
def test_a_plan_repeats_its_lap(plan, t, laps):
    t += plan.entry.duration + 1e-6  # beyond the seam
    shift = plan.derivatives(t + laps * plan.circuit.duration) - plan.derivatives(t)
    shift[0, 3] = np.sin(shift[0, 3] / 2)
    # Rounding may put one of the two beyond a gate, where yaw starts again.
    np.testing.assert_allclose(shift, 0.0, atol=1e-5)
    assert plan.lap_at(t + laps * plan.circuit.duration + 1e-9) in (
        plan.lap_at(t + 1e-9) + laps,
        plan.lap_at(t - 1e-6) + laps,
    )


@few
@given(plans, times)
def test_laps_and_their_starts_agree(plan, t):
    lap, start = plan.lap_at(t), plan.next_start(t)
    assert start > t - 1e-9
    assert start - t <= plan.circuit.duration + 1e-9 or lap == plan.lap - 1
    assert plan.lap_at(start + 1e-6) == lap + 1
    assert plan.lap_at(start - 1e-6) == lap
    assert plan.lap - 1 <= lap
    if start > plan.start_time + plan.entry.duration:
        np.testing.assert_allclose(plan.derivatives(start)[0, :3], GATES[0].p_WG, atol=1e-6)
    # All gates of a lap are passed where the circuit says.
    for gate, passing in zip(GATES, plan.circuit.gate_times):
        if start > plan.start_time + plan.entry.duration:
            p = plan.derivatives(start + passing)[0, :3]
            np.testing.assert_allclose(p, gate.p_WG, atol=1e-6)


@few
@given(plans, times, st.floats(0.0, 60.0))
def test_laps_only_count_up(plan, t, later):
    assert plan.lap_at(t + later) >= plan.lap_at(t)
    assert plan.next_start(t + later) >= plan.next_start(t)


def test_a_plan_is_shared_not_copied():
    plan = make_plan(3, True)
    assert Value[object](plan).Clone().get_value() is plan
    assert Value[object](NO_PLAN).Clone().get_value() is NO_PLAN


@pytest.mark.parametrize("answer", [3, "plan", [1.0], np.zeros(4), False, (None,)])
def test_a_function_of_ones_own_that_gives_no_plan_is_named(answer):
    bench = Bench(solve=lambda problem: answer)
    with pytest.raises(UserError, match=r"noted\(\) gave .*; it must give a LapPlan .*, or None"):
        bench.plan_at(1.0)


def test_a_plan_that_is_not_finite_is_refused():
    def solve(problem):
        plan = plan_lap(problem)
        return dc.replace(plan, start_time=np.nan)

    with pytest.raises(UserError, match="LapPlan.start_time, gave nan"):
        Bench(solve=solve).plan_at(1.0)
