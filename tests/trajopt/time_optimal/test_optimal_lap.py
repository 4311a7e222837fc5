"""Time-optimal laps: fast, within every limit, fair, and refused where there is none."""

import dataclasses as dc
import functools
import time

import numpy as np
import pytest

from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.feasibility import pylon_distances
from airrace.trajopt.flight_limits import MIN_HEIGHT, FlightConstraints, FlightLimits
from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.min_snap.circuit import plan_circuit
from airrace.trajopt.reference import as_reference
from airrace.trajopt.time_optimal.lap_search import IN_FLIGHT, Effort
from airrace.trajopt.time_optimal.optimal_lap import plan_optimal_circuit
from airrace.vehicle import load_vehicle
from tests.worlds.published_laps import CLEARANCE, LIMITS, load_course, regions
from tests.worlds.rotor_check import greatest_bearing, rotor_shares

VEHICLES = {name: load_vehicle(name)[0] for name in ("Default", "StarOne")}
MIDPOINTS, HEADINGS, PYLONS = load_course()
HALF_VIEW = np.deg2rad(40.0)


def square(side=40.0, turned=0.0):
    headings = np.pi / 2 * np.arange(4)
    out = np.column_stack([np.sin(headings), -np.cos(headings), np.zeros(4)])
    headings[2] += turned
    return side / 2 * out + [0.0, 0.0, 6.0], headings


def pylons_of(midpoints, headings):
    right = 5.0 * np.column_stack([np.sin(headings), -np.cos(headings)])
    return np.vstack([midpoints[:, :2] - right, midpoints[:, :2] + right])


def plan(midpoints, headings, limits="rotor", drone="Default", kind="windows", **options):
    limits = FlightLimits(VEHICLES[drone], **LIMITS[limits]) if isinstance(limits, str) else limits
    constraints = FlightConstraints(
        options.pop("pylons", pylons_of(midpoints, headings)),
        options.pop("clearance", CLEARANCE),
        limits,
        options.pop("half_view", HALF_VIEW),
    )
    return plan_optimal_circuit(regions(kind, midpoints, headings), constraints, **options)


@functools.cache
def reference(limits="rotor", kind="windows"):
    return plan(MIDPOINTS, HEADINGS, limits, kind=kind)


@functools.cache
def small(drone="Default", limits="rotor"):
    return plan(*square(), limits, drone)


def assert_raceable(lap, midpoints, headings, limits=None, drone="Default", half_size=(3.2, 2.5)):
    """Checks anew that a lap keeps its limits."""
    limits = limits or {}
    samples = lap.sample(np.arange(0.0, lap.duration, 1e-3))
    least, most = rotor_shares(lap, VEHICLES[drone])
    assert least > -0.005 and most < 1.005
    assert np.linalg.norm(as_reference(samples).velocity, axis=0).max() <= limits.get(
        "max_speed", np.inf
    )
    assert np.linalg.norm(samples[6:9], axis=0).max() <= limits.get("max_acceleration", np.inf)
    assert samples[2].min() >= MIN_HEIGHT
    assert pylon_distances(samples, pylons_of(midpoints, headings)).min() >= CLEARANCE
    crossing = lap.sample(lap.gate_times[:-1])
    offset = crossing[:3].T - midpoints
    forward = np.column_stack([np.cos(headings), np.sin(headings)])
    assert np.abs(np.sum(offset[:, :2] * forward, axis=1)).max() < 1e-3
    assert np.linalg.norm(offset[:, :2], axis=1).max() < half_size[0] + 1e-3
    assert np.abs(offset[:, 2]).max() < half_size[1] + 1e-3
    v = crossing[3:5].T
    assert np.all(np.sum(v * forward, axis=1) > 0.49 * np.linalg.norm(v, axis=1))


@pytest.mark.slow
@pytest.mark.parametrize(
    "limits, kind, longest",
    [("original", "balls", 21.0), ("original", "windows", 19.3), ("rotor", "windows", 10.0)],
)
def test_the_reference_track(limits, kind, longest):
    lap = reference(limits, kind)
    assert lap.summary.bound < lap.duration < longest
    assert lap.duration < 1.015 * lap.summary.bound
    assert greatest_bearing(lap, MIDPOINTS) < np.deg2rad(40.5)
    if kind == "balls":
        crossing = lap.sample(lap.gate_times[:-1])[:3].T
        assert np.linalg.norm(crossing - MIDPOINTS, axis=1).max() < 0.4 + 1e-3
    else:
        assert_raceable(lap, MIDPOINTS, HEADINGS, LIMITS[limits])


@pytest.mark.slow
def test_the_report_says_what_is_so():
    lap, check = reference(), reference().summary.check
    samples = lap.sample(np.arange(0.0, lap.duration, 1e-3))
    least, most = rotor_shares(lap, VEHICLES["Default"])
    assert max(check.max_thrusts) / 8.5 == pytest.approx(most, abs=0.005)
    assert min(check.min_thrusts) / 8.5 == pytest.approx(least, abs=0.005)
    speed = np.linalg.norm(as_reference(samples).velocity, axis=0).max()
    assert check.max_speed == pytest.approx(speed, rel=1e-4)
    assert check.clearance == pytest.approx(pylon_distances(samples, PYLONS).min(), abs=1e-3)
    assert check.active_limits == ("thrust",) and -1e-3 < check.excess <= 0.0
    assert reference("original").summary.check.active_limits == ("speed", "acceleration")
    assert 0 < lap.summary.iterations and not lap.summary.warm


def test_it_is_faster_than_minimum_snap():
    constraints = FlightConstraints(
        PYLONS, CLEARANCE, FlightLimits(VEHICLES["Default"], **LIMITS["original"])
    )
    slow = plan_circuit(MIDPOINTS, HEADINGS, 4, constraints)
    assert reference("original", "balls").duration < 0.95 * slow.duration


@pytest.mark.parametrize("drone", VEHICLES)
def test_a_small_track(drone):
    lap = small(drone)
    assert_raceable(lap, *square(), drone=drone)
    assert greatest_bearing(lap, square()[0]) < np.deg2rad(40.5)
    assert lap.summary.check.active_limits == ("thrust",)


def test_it_is_smooth_all_around():
    lap = small()
    for t in lap.breaks[1:-1]:
        before, after = lap.derivatives(t - 1e-9), lap.derivatives(t + 1e-9)
        np.testing.assert_allclose(before[:, :3], after[:, :3], atol=1e-3)
        np.testing.assert_allclose(before[:3, 3], after[:3, 3], atol=1e-5)
    seam = lap.derivatives(lap.duration) - lap.derivatives(0.0)
    np.testing.assert_allclose(seam[:, :3], 0.0, atol=1e-6)
    np.testing.assert_allclose(seam[:3, 3], [2 * np.pi, 0.0, 0.0], atol=1e-4)
    assert lap.gate_times[0] == 0.0 and lap.gate_times[-1] == pytest.approx(lap.duration)


@pytest.mark.parametrize("angle, mirrored", [(0.7, False), (-2.0, True)])
def test_it_does_not_matter_where_the_track_lies(angle, mirrored):
    midpoints, headings = square()
    if mirrored:
        midpoints, headings = midpoints * [1, -1, 1], -headings
    c, s = np.cos(angle), np.sin(angle)
    midpoints = midpoints @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]).T + [300.0, -80.0, 0.0]
    lap = plan(midpoints, headings + angle)
    assert_raceable(lap, midpoints, headings + angle)
    # Reached from another side: to the tolerance of the search.
    assert lap.duration == pytest.approx(small().duration, rel=5e-3)


@pytest.mark.slow
def test_limits_cost_time():
    free = small()
    for name, value in (
        ("thrust_share", 0.8),
        ("max_rate", 1.2),
        ("max_speed", 12.0),
        ("max_acceleration", 15.0),
    ):
        limits = dc.replace(FlightLimits(VEHICLES["Default"]), **{name: value})
        lap = plan(*square(), limits)
        assert lap.duration > 1.005 * free.duration, name
        check = lap.summary.check
        assert check.excess <= 0.0
        assert max(check.max_thrusts) <= 8.5 * limits.thrust_share
        assert check.max_rate <= limits.max_rate and check.max_speed <= limits.max_speed


def test_the_view_costs_time_if_it_must_be_narrow():
    durations = [plan(*square(), half_view=np.deg2rad(h)).duration for h in (180.0, 40.0, 15.0)]
    assert durations[0] < durations[1] * 1.002 < durations[2] * 1.002


def moved(seed):
    rng = np.random.default_rng(seed)
    return MIDPOINTS + rng.normal(scale=0.3 / np.sqrt(3), size=MIDPOINTS.shape), HEADINGS


@pytest.mark.slow
def test_a_lap_through_moved_gates_from_the_one_before():
    midpoints, headings = moved(0)
    cold = plan(midpoints, headings)
    warm = plan(midpoints, headings, previous=reference())
    assert_raceable(warm, midpoints, headings)
    assert warm.summary.warm and warm.summary.iterations <= IN_FLIGHT.iterations
    assert warm.duration < 1.02 * cold.duration


def test_a_lap_through_other_gates_is_no_help_and_no_harm():
    far = plan(*square(400.0))
    lap = plan(*square(), previous=far, effort=Effort())
    assert lap.duration == pytest.approx(small().duration, rel=5e-3)
    other = plan(*square(), previous=reference())  # more gates
    assert other.duration == small().duration


def test_the_same_input_gives_the_same_lap():
    again = plan(*square())
    times = np.linspace(0.0, again.duration, 100)
    assert again.duration == small().duration
    np.testing.assert_array_equal(again.sample(times), small().sample(times))


def test_a_gate_askew_is_crossed_forward():
    midpoints, headings = square(turned=1.0)
    assert_raceable(plan(midpoints, headings), midpoints, headings)


def impossible():
    midpoints, headings = square()
    pylons = pylons_of(midpoints, headings)
    twice, low, nan = midpoints.copy(), midpoints.copy(), midpoints.copy()
    twice[2], low[1, 2], nan[0, 0] = twice[1], -3.0, np.nan
    wall = [[x, y] for x in (-4, 0, 4) for y in range(-60, 61, 2)]
    base = FlightLimits(VEHICLES["Default"])
    return {
        "one gate twice": ((twice, headings), {}, "coincide"),
        "one gate": ((midpoints[:1], headings[:1]), {}, "two gates"),
        "not a number": ((nan, headings), {"pylons": pylons}, "finite"),
        "pylon not a number": ((midpoints, headings), {"pylons": [[np.nan, 0.0]]}, "finite"),
        "a gate below ground": ((low, headings), {}, "least height"),
        "pylons in a gate": (
            (midpoints, headings),
            {"pylons": [*pylons, *(midpoints[3, :2] + [[0, 0], [2, 0], [-2, 0]])]},
            "clear",
        ),
        "a wall of pylons": ((midpoints, headings), {"pylons": wall}, "clear"),
        "no hover": (
            (midpoints, headings),
            {"limits": dc.replace(base, thrust_share=0.25)},
            "hover",
        ),
        "no speed": (
            (midpoints, headings),
            {"limits": dc.replace(base, max_speed=0.0)},
            "max_speed",
        ),
        "rotors not a number": (
            (midpoints, headings),
            {"limits": dc.replace(base, thrust_share=np.nan)},
            "thrust_share",
        ),
        "no view": ((midpoints, headings), {"half_view": 0.0}, "half_view"),
    }


@pytest.mark.slow
@pytest.mark.parametrize("case", impossible())
def test_impossible_laps_are_refused_in_time(case):
    gates, options, word = impossible()[case]
    clock = time.process_time()
    with pytest.raises(TrajectoryOptimizationError, match=word):
        plan(*gates, **options)
    assert time.process_time() - clock < 10.0


def test_a_gate_without_room_is_refused():
    with pytest.raises(TrajectoryOptimizationError, match="Gate 2 leaves no room"):
        GateRegions.windows(*square(), [1.0, -0.2, 1.0, 1.0], 2.5)
