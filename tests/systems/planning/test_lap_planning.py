"""The planning problem of a lap, solved as a function of values."""

import dataclasses as dc
import functools
import pickle
import types

import numpy as np
import pytest
from threadpoolctl import ThreadpoolController

from airrace.evaluation.jobs import generated_track
from airrace.scenario.lap_limits import parse_limits
from airrace.systems.planning import lap_planning
from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.systems.planning.lap_planning import plan_lap
from airrace.systems.planning.laps import LapProblem
from airrace.systems.planning.map_margins import pylon_margins
from airrace.systems.planning.min_snap_laps import MinSnapLaps
from airrace.systems.planning.time_optimal_laps import TimeOptimalLaps
from airrace.track import Gate, Start, Track, load_track
from airrace.track.gate_map import GateEstimate
from airrace.track.map_files import true_map
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.feasibility import pylon_distances, sample_times
from airrace.trajopt.flatness import inverse_dynamics
from airrace.trajopt.flight_limits import FlightLimits
from airrace.trajopt.min_snap.circuit import LapStyle
from airrace.trajopt.reference import as_reference
from airrace.vehicle import load_vehicle
from airrace.vehicle.air import Air
from tests.worlds import cases

VEHICLE = load_vehicle("Default")[0]
GATES = tuple(
    GateEstimate(number=n, p_WG=gate.p_WG, heading=gate.heading, spacing=gate.pylon_spacing)
    for n, gate in enumerate(load_track("student-airrace").gates)
)
HOVER = np.zeros((5, 4))
HOVER[0] = 0.0, 0.0, 5.0, 0.0


def problem(
    trajectory="optimal",
    limits="original",
    gates=GATES,
    extra=0.0,
    old=NO_PLAN,
    thrust_share=0.9,
    **changes,
):
    speed, acceleration = parse_limits(limits)
    time, start = 1.0, HOVER
    if old is not NO_PLAN:
        time = old.next_start(old.start_time + old.entry.duration + 1.0)
        time -= old.circuit.duration - old.circuit.gate_times[-2] - 0.02
        start = old.derivatives(time)
    return LapProblem(
        **dict(
            trajectory=trajectory,
            limits=FlightLimits(
                VEHICLE, thrust_share=thrust_share, max_speed=speed, max_acceleration=acceleration
            ),
            gates=gates,
            pylons=np.array([g.pylons for g in gates]).reshape(-1, 2),
            margins=pylon_margins(gates, ()) + extra,
            start_time=time,
            start=start,
            old=old,
            rotor_factors=np.ones(4),
            air=np.zeros(7),
        )
        | changes
    )


@functools.cache
def first(trajectory="optimal", limits="original"):
    return plan_lap(problem(trajectory, limits))


def moved(distance, seed=0):
    rng = np.random.default_rng(seed)
    return tuple(
        dc.replace(g, p_WG=g.p_WG + rng.normal(scale=distance / np.sqrt(3), size=3)) for g in GATES
    )


def assert_same(one, other):
    assert one.lap == other.lap and one.phase == other.phase
    for t in np.linspace(one.start_time, one.start_time + 25.0, 50):
        np.testing.assert_array_equal(one.derivatives(t), other.derivatives(t))
    assert dc.replace(one.summary, solve_time=0.0) == dc.replace(
        other.summary, solve_time=0.0
    ) or str(dc.replace(one.summary, solve_time=0.0)) == str(
        dc.replace(other.summary, solve_time=0.0)
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "trajectory, style",
    [("3", LapStyle()), ("optimal", LapStyle()), ("4", LapStyle(rests=True, soft=True))],
)
def test_another_process_would_find_the_same_plan(trajectory, style):
    old = plan_lap(problem(trajectory, style=style)) if style.rests else first(trajectory)
    given = problem(trajectory, gates=moved(0.1), old=old, style=style, always=True)
    copy = pickle.loads(pickle.dumps(given))
    assert copy.old is not given.old
    assert_same(pickle.loads(pickle.dumps(plan_lap(copy))), plan_lap(given))


@pytest.mark.slow
def test_a_plan_is_the_same_however_many_cores_there_are():
    plans = []
    for cores in (1, 2):
        with ThreadpoolController().limit(limits=cores, user_api="blas"):
            plans.append(plan_lap(problem()))
    assert_same(*plans)


@pytest.mark.slow
@pytest.mark.parametrize("seed", cases.first([1047, 1143]))
def test_no_transition_onto_a_lap_loops_before_a_gate(seed):
    """There, a search from the best of its guesses ends with a loop that takes two seconds."""
    track, _ = generated_track(seed)
    hover = np.zeros((5, 4))
    hover[0] = *track.start.position[:2], 5.9, np.deg2rad(track.start.heading_deg)
    gates = true_map(track).gates
    plan = plan_lap(problem(gates=gates, extra=1.0, start=hover))
    assert plan.entry.duration - plan.phase < 2.5
    # It passes the plane of each gate just once.
    times = np.linspace(0.0, plan.entry.duration, 2000)
    for gate in gates[: np.searchsorted(plan.circuit.gate_times, plan.phase)]:
        forward = [np.cos(gate.heading), np.sin(gate.heading), 0.0]
        ahead = forward @ (plan.entry.positions(times) - gate.p_WG[:, None])
        assert np.count_nonzero(np.diff(ahead > 0.0)) == 1


@pytest.mark.slow
def test_a_lap_far_from_the_old_one_is_reached():
    """The old plan, that keeps another metre from pylons, is no guess of the way onto the new."""
    gates = true_map(generated_track(3)[0]).gates
    old = plan_lap(problem(limits="rotor", gates=gates, extra=1.2, thrust_share=1.0))
    given = problem(limits="rotor", gates=gates, extra=0.2, thrust_share=1.0, old=old)
    quickest = TimeOptimalLaps(given).lap(None).duration
    assert quickest < 0.97 * old.circuit.duration
    assert plan_lap(given).circuit.duration == quickest


@pytest.mark.slow
@pytest.mark.parametrize("limits", cases.first(["v=15,a=8", "rotor", "original", "a=12"], 2))
@pytest.mark.parametrize("trajectory", cases.first(["optimal", "4", "3", "6"], 2))
def test_limits_are_kept_and_used_and_the_report_is_true(trajectory, limits):
    plan = first(trajectory, limits)
    samples = np.hstack(
        [part.sample(sample_times(part, 1000.0)) for part in (plan.entry, plan.circuit)]
    )
    _, velocity, acceleration, *_ = as_reference(samples)
    speed, acceleration = (np.linalg.norm(x, axis=0) for x in (velocity, acceleration))
    thrusts, w = inverse_dynamics(samples, VEHICLE)
    summary, most = plan.summary, 0.9 * VEHICLE.max_thrusts[0]
    v, a = parse_limits(limits)
    assert speed.max() <= v * (1 + 1e-4) and acceleration.max() <= a * (1 + 1e-4)
    assert thrusts.max() <= most * (1 + 1e-4) and thrusts.min() >= -0.005 * most
    assert summary.active_limits
    assert summary.max_speed == pytest.approx(speed.max())
    assert summary.max_acceleration == pytest.approx(acceleration.max())
    np.testing.assert_allclose(summary.max_thrusts, thrusts.max(axis=1))
    np.testing.assert_allclose(summary.min_thrusts, thrusts.min(axis=1))
    assert summary.max_rotor_thrust == max(summary.max_thrusts)
    assert summary.max_rate == pytest.approx(np.linalg.norm(w, axis=0).max())
    assert summary.clearance == pytest.approx(
        pylon_distances(samples, problem().pylons).min(), abs=1e-9
    )
    # No lap beats a point mass; an optimal one comes near it.
    assert 0.0 < summary.gap < {"optimal": 0.03, "3": 0.6, "4": 0.6, "6": 1.4}[trajectory]
    assert summary.duration == plan.circuit.duration


@pytest.mark.slow
def test_laps_get_faster_as_the_map_gets_better():
    durations = [plan_lap(problem(extra=extra)).circuit.duration for extra in (0.6, 0.3, 0.0)]
    assert durations[0] > durations[1] + 0.05 > durations[2] + 0.1


@pytest.mark.slow
def test_the_next_lap_goes_on_from_the_last():
    old = first()
    new = plan_lap(problem(gates=moved(0.2), old=old))
    assert new.lap == 2 and new.summary.warm
    t = new.start_time
    jump = new.derivatives(t) - old.derivatives(t)
    jump[0, 3] = np.sin(jump[0, 3] / 2)
    np.testing.assert_allclose(jump[:, :3], 0.0, atol=1e-6)
    np.testing.assert_allclose(jump[:3, 3], 0.0, atol=1e-6)


def test_a_slower_lap_is_not_flown_while_the_old_one_will_do():
    """More room would be nice to have, but the map has not changed."""
    old = first()
    assert plan_lap(problem(extra=0.03, old=old)) is None
    # Where the old one comes too near, a slower one is right.
    wider = plan_lap(problem(extra=0.5, old=old))
    assert wider.circuit.duration > old.circuit.duration


class Laps:
    """Finds laps that take what a test says, from the lap before and from nothing."""

    def __init__(self, warm, cold, fits=False):
        self.asked, self._found, self._fits = [], {"warm": warm, "cold": cold}, fits

    point_mass_lap = types.SimpleNamespace(duration=18.0)

    def lap(self, previous):
        kind = "cold" if previous is None else "warm"
        self.asked.append(kind)
        if self._found[kind] is None:
            raise TrajectoryOptimizationError("none")
        return dc.make_dataclass("Lap", ["duration", "kind"])(self._found[kind], kind)

    def fits(self, circuit):
        return self._fits


@pytest.mark.parametrize(
    "warm, cold, fits, asked, kinds",
    [
        (18.2, 18.1, False, ["warm"], ["warm"]),  # as good as before: no need for more
        (25.0, 19.0, False, ["warm", "cold"], ["cold", "warm"]),  # stalled
        (25.0, None, False, ["warm", "cold"], ["warm"]),  # slow, but the gates have moved
        (25.0, 24.0, True, ["warm", "cold"], []),  # never flown
        (25.0, 18.5, True, ["warm", "cold"], ["cold"]),  # the old is better than the other
        (None, 19.0, False, ["warm", "cold"], ["cold"]),
        (None, None, True, ["warm", "cold"], []),
    ],
)
def test_a_stalled_search_starts_anew_and_the_best_is_kept(warm, cold, fits, asked, kinds):
    laps = Laps(warm, cold, fits)
    found, bound = lap_planning._best_laps(laps, first())
    assert laps.asked == asked and bound == 18.0
    assert [lap.kind for lap in found] == kinds


def test_an_old_lap_that_asks_too_much_of_a_rotor_does_not_fit():
    given = problem()
    for factor, fits in ((1.0, True), (0.4, False)):
        vehicle = VEHICLE.with_thrusts([1.0, factor, 1.0, 1.0])
        weaker = dc.replace(given, limits=dc.replace(given.limits, vehicle=vehicle))
        assert TimeOptimalLaps(weaker).fits(first().circuit) == fits
    in_air = dc.replace(given, limits=dc.replace(given.limits, air=Air(0.5, 0.0, np.zeros(3))))
    assert not TimeOptimalLaps(in_air).fits(first().circuit)


@pytest.mark.slow
def test_a_plan_of_rotors_that_turned_out_weaker_is_left_for_one_that_they_can_fly():
    """The transition begins where the old plan is beyond their limits."""
    old = first("optimal", "rotor")
    given = problem(limits="rotor", old=old)
    weaker = dc.replace(given.limits, vehicle=VEHICLE.with_thrusts([0.93] * 4))
    plan = plan_lap(dc.replace(given, limits=weaker))
    assert plan.circuit.duration > old.circuit.duration
    assert max(plan.summary.max_thrusts) <= 1.02 * max(old.summary.max_thrusts)


@pytest.mark.slow
def test_a_plan_of_still_air_is_left_for_one_that_drag_allows():
    """Where the old plan asks far too much, the transition does so at its begin alone."""
    old = first("optimal", "rotor")
    given = problem(limits="rotor", old=old)
    air = Air(0.05, 0.003, np.zeros(3))
    given = dc.replace(given, limits=dc.replace(given.limits, air=air))
    plan = plan_lap(given)
    assert given.old_share(0.3) > 1.1
    most = max(given.limits.thrust_share, given.old_share(0.02))
    assert max(plan.summary.max_thrusts) <= 1.01 * most * VEHICLE.max_thrusts[0]


def test_a_transition_begins_where_the_old_plan_asks_for_less():
    class Old:
        """At a hover, but for a jerk of the first tenth of a second, which turns the drone."""

        def next_start(self, time):
            return 3.0

        def derivatives(self, time):
            result = HOVER.copy()
            result[4, 0] = 4000.0 if time < 2.1 else 0.0
            return result

    given = problem(limits="rotor")
    begun = dc.replace(given, old=Old(), start_time=2.0)
    later = begun.from_where_it_is_easy(0.05)
    assert begun.old_share(0.1) > given.limits.thrust_share > later.old_share(0.1)
    assert later.start_time == pytest.approx(2.1, abs=0.051) and later.remaining < 1.0
    assert not later.start[4].any()
    for untouched in (given, later):
        assert untouched.from_where_it_is_easy(0.05) is untouched


def test_a_lap_that_is_hardly_quicker_is_not_flown():
    """The way onto it would take longer than what it gains, where rotors are at their limits."""
    old = first()
    for gain, kinds in ((5e-4, []), (2e-3, ["warm"])):
        laps = Laps(old.circuit.duration - gain, None, fits=True)
        found, _ = lap_planning._best_laps(laps, old)
        assert [lap.kind for lap in found] == kinds


def test_where_nothing_leads_onto_the_quickest_lap_another_is_flown(monkeypatch):
    given, unreachable = problem("4", gates=moved(0.1), old=first("4"), always=True), object()
    usual = plan_lap(given)

    class Stuck(MinSnapLaps):
        def transition(self, circuit, start, remaining):
            if circuit is unreachable:
                raise TrajectoryOptimizationError("none")
            return super().transition(circuit, start, remaining)

    monkeypatch.setattr(lap_planning, "MinSnapLaps", Stuck)
    for found, plan in (([unreachable, usual.circuit], usual), ([unreachable], None)):
        monkeypatch.setattr(lap_planning, "_best_laps", lambda *_, found=found: (found, 1.0))
        flown = plan_lap(given)
        assert (flown and flown.circuit) is (plan and plan.circuit)


@pytest.mark.parametrize("trajectory", cases.first(["4", "optimal"]))
@pytest.mark.parametrize("fault", ["narrow", "coincide", "behind a pylon", "no hover", "no gates"])
def test_what_cannot_be_flown_gives_no_plan(trajectory, fault):
    given = {
        "narrow": lambda: problem(
            trajectory, gates=tuple(dc.replace(g, spacing=3.0) for g in GATES)
        ),
        "coincide": lambda: problem(trajectory, gates=(GATES[0], GATES[0], *GATES[2:])),
        "behind a pylon": lambda: problem(
            trajectory,
            pylons=np.vstack(
                [problem().pylons, GATES[3].p_WG[:2] + [[0, 0], [1.5, 1.5], [-1.5, -1.5]]]
            ),
            margins=np.full(23, 0.3),
        ),
        "no hover": lambda: problem(trajectory, thrust_share=0.2),
        "no gates": lambda: problem(trajectory, gates=()),
    }[fault]()
    assert plan_lap(given) is None


ORIGINAL = LapStyle(rests=True, soft=True)


@pytest.mark.slow
@pytest.mark.parametrize("style", [LapStyle(rests=True), ORIGINAL])
@pytest.mark.parametrize("trajectory", cases.first(["3", "6", "4"], 2))
def test_laps_from_rest_to_rest_follow_one_another(trajectory, style):
    old = plan_lap(problem(trajectory, extra=1.0, style=style))
    # From the hover over the start through gate 1, from the front, to rest.
    rest = old.circuit.derivatives(0.0)
    assert old.phase == 0.0 and np.abs(rest[1:]).max() < 1e-6
    for t, expected in ((0.0, HOVER), (old.entry.duration, rest)):
        np.testing.assert_allclose(old.entry.derivatives(t)[1:], expected[1:], atol=1e-6)
        np.testing.assert_allclose(old.entry.derivatives(t)[0, :3], expected[0, :3], atol=1e-8)
    p = old.entry.positions(np.linspace(0.0, old.entry.duration, 1000)).T - GATES[0].p_WG
    ahead = p @ [np.cos(GATES[0].heading), np.sin(GATES[0].heading), 0.0]
    assert np.count_nonzero(np.diff(ahead > 0.0)) == 1 and ahead[0] < 0.0
    for seed in range(2):
        new = plan_lap(
            problem(trajectory, gates=moved(0.05, seed), old=old, style=style, always=True)
        )
        assert new.lap == old.lap + 1 and new.phase == 0.0
        t = new.start_time
        jump = new.derivatives(t) - old.derivatives(t)
        jump[0, 3] = np.sin(jump[0, 3] / 2)
        np.testing.assert_allclose(jump, 0.0, atol=1e-5)
        np.testing.assert_allclose(new.entry.derivatives(new.entry.duration)[1:], 0.0, atol=1e-5)
        # The lap before ends when it would have ended: a little later at most.
        late = new.next_start(t) - old.next_start(t)
        assert -1e-9 <= late < 0.06 * (old.circuit.duration - old.circuit.gate_times[-2])
        old = new
    soft = style.soft and trajectory == "3"
    assert old.summary.max_speed <= (22.0 if soft else 20.0 + 1e-3)
    assert old.summary.max_acceleration <= (11.0 if soft else 10.0 + 1e-3)
    assert max(old.summary.max_thrusts) <= 0.9 * VEHICLE.max_thrusts[0] * (1 + 1e-4)
    assert old.summary.solver == ("BOBYQA" if style.soft else "SNOPT")


@pytest.mark.slow
def test_where_soft_laps_come_too_near_to_pylons_the_quickest_is_flown():
    track, _ = generated_track(1003)
    hover = np.zeros((5, 4))
    hover[0] = *track.start.position[:2], track.hover_height, np.deg2rad(track.start.heading_deg)
    given = dict(gates=true_map(track).gates, start=hover)
    plan = plan_lap(problem("4", style=ORIGINAL, **given))
    quickest = plan_lap(problem("4", style=LapStyle(rests=True), **given))
    assert plan.summary.solver == "SNOPT" and plan.circuit.breaks == quickest.circuit.breaks
    assert plan.summary.clearance > 1.8


@pytest.mark.slow
def test_an_old_lap_to_rest_still_fits_its_own_map():
    old = plan_lap(problem("3", style=LapStyle(rests=True)))
    laps = MinSnapLaps(problem("3", style=LapStyle(rests=True), old=old))
    assert laps.fits(old.circuit)
    elsewhere = problem("3", gates=moved(0.5), style=LapStyle(rests=True), old=old)
    assert not MinSnapLaps(elsewhere).fits(old.circuit)


def test_always_a_new_lap_even_if_it_is_slower():
    laps = Laps(25.0, 24.0, fits=True)
    assert lap_planning._best_laps(laps, first())[0] == []
    assert lap_planning._best_laps(laps, first(), always=True)[0][0].kind == "cold"
    # Where none is found, the old one goes on.
    assert lap_planning._best_laps(Laps(None, None, fits=True), first(), always=True)[0] == []


def in_a_row():
    """Three gates in one line, 25 m apart, as no track may have, and a map might; and a start."""
    track = Track(
        name="in a row",
        start=Start(position=[-20.0, 0.0, 0.0], heading_deg=0.0),
        hover_height=5.0,
        gates=[Gate(left_pylon=[x, 5.0], heading_deg=0.0) for x in (0.0, 25.0, 50.0)],
    )
    start = np.zeros((5, 4))
    start[0] = -20.0, 0.0, 5.0, 0.0
    gates = true_map(track).gates
    return dict(
        gates=gates, start=start, margins=pylon_margins(gates, true_map(track).markers, 1.0)
    )


@pytest.mark.parametrize(
    "trajectory", ["3", "4", "6", pytest.param("optimal", marks=pytest.mark.slow)]
)
def test_no_search_loses_its_way_on_the_long_way_back(trajectory):
    plan = plan_lap(problem(trajectory, **in_a_row()))
    assert 8.0 < plan.circuit.duration < 15.0 and plan.entry.duration < 10.0


@pytest.mark.parametrize("trajectory", cases.first(["3", "4", "6"]))
@pytest.mark.parametrize("limits", ["rotor", "v=30,a=25"])
def test_a_lap_too_quick_to_enter_is_flown_more_slowly_at_first(trajectory, limits):
    """A looser limit does not lose what a tighter one has."""
    track = load_track("hexagon")
    start = np.zeros((5, 4))
    start[0, :3] = [*track.start.position[:2], track.hover_height]
    plan = plan_lap(problem(trajectory, limits, gates=true_map(track).gates, start=start))
    usual = {"3": 8.2, "4": 8.2, "6": 12.0}[trajectory]
    assert plan is not None and plan.circuit.duration < usual
