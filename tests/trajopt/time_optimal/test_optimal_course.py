"""Open courses: from rest to rest, upside down, low, through gates of any kind, twice and back."""

import dataclasses as dc
import functools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from airrace.common.errors import UserError
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.flight_limits import FlightConstraints, FlightLimits
from airrace.trajopt.gate_regions import GateRegions, Region
from airrace.trajopt.time_optimal import optimal_course
from airrace.trajopt.time_optimal.lap_samples import Grid, LapSamples
from airrace.trajopt.time_optimal.lap_search import Effort
from airrace.trajopt.time_optimal.optimal_course import plan_optimal_course
from airrace.vehicle import GRAVITY, load_vehicle
from tests.worlds import cases

VEHICLE = load_vehicle("Default")[0]
RATES = (15.0, 15.0, 3.0)  # rad/s
START, GOAL, RADIUS, MIN_HEIGHT = [0.0, 0.0, 1.0], [4.0, -3.0, 1.0], 0.3, 0.5  # m
DIVE = np.array([[8.0, 4.0, 3.0], [-6.0, 0.0, 4.0], [-6.0, 0.0, 1.5]])  # m
LIMITS = FlightLimits(VEHICLE, max_rate=np.inf, max_axis_rates=RATES, min_lift=-np.inf)
FREE = FlightConstraints((), 0.0, LIMITS, half_view=np.pi, min_height=MIN_HEIGHT)


def balls(places=DIVE, between=(START, GOAL), headings=None):
    return GateRegions.balls(places, headings, RADIUS, between=between)


@functools.cache
def dive():
    return plan_optimal_course(balls(), FREE)


def test_it_passes_all_waypoints_from_rest_to_rest_in_order():
    course, states = dive(), dive().states()
    at = [np.argmin(abs(states.times - t)) for t in course.gate_times]
    places = states.positions[:, at].T
    np.testing.assert_allclose(places[[0, -1]], [START, GOAL], atol=1e-6)
    np.testing.assert_allclose(states.velocities[:, [0, -1]], 0.0, atol=1e-6)
    np.testing.assert_allclose(states.rotations[2, 2, [0, -1]], 1.0, atol=1e-6)
    np.testing.assert_allclose(states.rotations[:, :, 0], np.eye(3), atol=1e-6)
    # A sample is up to a millisecond off the waypoint.
    assert np.linalg.norm(places[1:-1] - DIVE, axis=1).max() < RADIUS + 0.02
    assert states.positions[2].min() > MIN_HEIGHT - 0.05
    assert states.rotations[2, 2].min() < 0.0  # upside down
    assert course.bound < course.duration == pytest.approx(states.times[-1])


def test_it_is_what_the_rotors_do():
    """Forces, rates and moments anew, from differences of the states."""
    states = dive().states()
    h, R = np.diff(states.times), np.moveaxis(states.rotations, 2, 0)
    middle = (states.times[1:] + states.times[:-1]) / 2
    force = np.diff(states.velocities) / h + [[0.0], [0.0], [GRAVITY]]
    total = np.interp(middle, states.times, states.thrusts.sum(axis=0))
    axis = R[:-1, :, 2] + R[1:, :, 2]
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    np.testing.assert_allclose(force, (total / VEHICLE.mass) * axis.T, atol=0.5)
    w = Rotation.from_matrix(np.swapaxes(R[:-1], 1, 2) @ R[1:]).as_rotvec().T / h
    np.testing.assert_allclose(
        w, (states.angular_velocities[:, 1:] + states.angular_velocities[:, :-1]) / 2, atol=0.05
    )
    J = np.array(VEHICLE.inertia)[:, None]
    alpha = np.gradient(states.angular_velocities, states.times, axis=1)
    w = states.angular_velocities
    moments = J * alpha + np.cross(w, J * w, axis=0)
    expected = (VEHICLE.allocation @ states.thrusts)[1:]
    assert np.quantile(abs(moments - expected), 0.99) < 0.01
    # Between the milliseconds of the check it may be a little more.
    most = 1.001 * VEHICLE.max_thrusts[:, None]
    assert states.thrusts.min() >= -1e-9
    assert (states.thrusts <= most).all()
    assert (np.abs(w) <= 1.001 * np.reshape(RATES, (3, 1))).all()


def test_an_attitude_that_is_none_exceeds_all_limits():
    """What the solver hands back when it fails may point along the pole of the chart."""
    lap, grid = dive().spline, Grid(dive().spline.pieces, 10, to_end=True)
    upside_down = dc.replace(lap, chart=np.diag([1.0, -1.0, -1.0]))  # at rest, it is at the pole
    with np.errstate(all="ignore"):
        assert not LapSamples.of(upside_down, grid, LIMITS, 0.0).excess() <= 0.0


def test_states_of_so_many_a_leg_are_those_of_the_others():
    few, all_of_them = dive().states(10), dive().states()
    assert few.times.size == 10 * 4 + 1
    assert few.times[10::10] == pytest.approx(dive().gate_times[1:])
    at = [np.interp(few.times, all_of_them.times, row) for row in all_of_them.positions]
    np.testing.assert_allclose(few.positions, at, atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("seed", cases.first([3, *range(3), *range(4, 10)]))
def test_courses_anywhere_come_near_to_what_a_point_mass_does(seed):
    """Waypoints near each other and far, level and steep, with turns back."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(size=(rng.integers(3, 7), 3)) * [6.0, 6.0, 2.0]
    places = np.cumsum(steps, axis=0) + [5.0, 0.0, 6.0]
    places[:, 2] = np.clip(places[:, 2], 2.0, 12.0)
    ends = [0.0, 0.0, 2.0], places[-1]
    course = plan_optimal_course(GateRegions.balls(places[:-1], None, 0.5, between=ends), FREE)
    assert course.duration < 1.15 * course.bound


def test_of_flights_that_exceed_a_little_the_one_is_kept_that_loses_least():
    """What a search within tighter limits finds may be worse than what it began with."""
    spline = dive().spline

    class Worse:
        """A search that finds a flight which takes twice as long, and turns far too quick."""

        constraints, grid = FREE, Grid(spline.pieces, 20, to_end=True)

        def improve(self, now, warm, effort):
            worse = dc.replace(spline, interior=1.5 * spline.interior)
            return LapSamples.of(worse.dilated(2.0), self.grid, LIMITS, 0.0), 1

    begun = spline.dilated(0.99)
    kept, iterations = optimal_course._kept(begun, Worse())
    assert iterations > 1 and kept.excess() <= 0.0
    assert kept.lap.duration == pytest.approx(spline.duration, rel=2e-3)


@pytest.mark.slow
def test_a_gate_may_come_twice_from_behind_and_tilted():
    corners = np.array([[6.0, -1.0, 2.0], [6.0, 1.0, 2.0], [5.0, 1.0, 4.0], [5.0, -1.0, 4.0]])
    gate = Region.polygon(corners)
    beyond = Region.ball([12.0, 0.0, 3.0], 0.5)
    limits = FlightLimits(VEHICLE)
    constraints = FlightConstraints((), 0.0, limits, half_view=np.pi, min_height=MIN_HEIGHT)
    gates = GateRegions.of_regions(
        [gate, beyond, gate], [0.0, np.pi / 2, np.pi], between=(START, [0.0, 1.0, 1.0])
    )
    course = plan_optimal_course(gates, constraints, ((6, Effort(10)),))
    states = course.states()
    at = [np.argmin(abs(states.times - t)) for t in course.gate_times[[1, 3]]]
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[1])
    normal /= np.linalg.norm(normal)
    assert np.abs((states.positions[:, at].T - corners[0]) @ normal).max() < 0.03
    assert np.abs(states.positions[1, at]).max() < 1.03
    assert states.velocities[0, at[0]] > 1.0 and states.velocities[0, at[1]] < -1.0


@pytest.mark.parametrize(
    "gates, changes, reason",
    [
        (lambda: balls(DIVE[[0, 0]]), {}, "Gate 1 and gate 2 coincide"),
        (lambda: balls(between=(START, DIVE[2])), {}, "Gate 3 and the goal coincide"),
        (lambda: balls(between=(START, [np.nan, 0.0, 1.0])), {}, "finite"),
        (lambda: balls(between=None), {}, "open"),
        (balls, {"max_axis_rates": (15.0, 0.0, 3.0)}, "max_axis_rates"),
        (balls, {"thrust_share": 0.1}, "hover"),
        (balls, {"idle_share": -0.1}, "idle_share"),
        (balls, {"min_lift": np.nan}, "min_lift"),
        (balls, {"clearance": np.nan}, "clearance"),
        (balls, {"min_height": np.nan}, "min_height"),
        (lambda: balls(headings=[0.0, 1.0]), {}, "for each of 3 gates, not 2"),
        (lambda: balls(between=(START,)), {}, "a start and a goal"),
        (lambda: balls(DIVE[:, :2]), {}, "three numbers"),
        (balls, {"clearance": np.ones(2)}, "each of 0 pylons"),
        (balls, {"pylons": np.ones((1, 3))}, "two finite numbers"),
        (balls, {"max_axis_rates": 15.0}, "three positive numbers"),
    ],
)
def test_what_cannot_be_is_refused(gates, changes, reason):
    own = {k: v for k, v in changes.items() if k in ("pylons", "clearance", "min_height")}
    limits = {k: v for k, v in changes.items() if k not in own}
    constraints = dc.replace(FREE, limits=dc.replace(LIMITS, **limits), **own)
    with pytest.raises(TrajectoryOptimizationError, match=reason):
        plan_optimal_course(gates(), constraints)


def test_a_start_below_the_least_height_is_refused():
    with pytest.raises(TrajectoryOptimizationError, match="start"):
        plan_optimal_course(balls(between=([0.0, 0.0, 0.2], GOAL)), FREE)


def test_a_vehicle_that_cannot_be_is_refused():
    rotors = [dc.replace(rotor, direction="CW") for rotor in VEHICLE.rotors]
    limits = dc.replace(LIMITS, vehicle=dc.replace(VEHICLE, rotors=rotors))
    with pytest.raises(UserError, match="direction of rotor 1"):
        plan_optimal_course(balls(), dc.replace(FREE, limits=limits))


def test_a_gate_may_be_behind_the_way_to_it():
    gate = Region.window([6.0, 0.0, 2.0], np.pi, 0.7, 0.7)
    between = [0.0, 0.0, 1.5], [12.0, 0.0, 1.5]

    def velocity(regions, effort):
        gates = GateRegions.of_regions(regions, [np.pi] * len(regions), between=between)
        course = plan_optimal_course(gates, FREE, ((6, effort),))
        return course.spline.gates[1 + len(regions) // 2, 1, 0]

    with pytest.raises(TrajectoryOptimizationError, match="gate 1 by 180 degrees off its heading"):
        velocity([gate], Effort(1))
    assert velocity([gate], Effort(40)) < 0.0  # and hardly that: it stops in the gate
    before, behind = (Region.ball([x, 0.0, 2.0], 0.5) for x in (7.5, 4.5))
    assert velocity([before, gate, behind], Effort(10)) < -3.0


def test_a_heading_holds_where_the_quickest_way_would_not_keep_it():
    """From the side, the gate would be crossed at a right angle to its heading."""
    gates = GateRegions.balls(
        [[6.0, 0.0, 2.0]], [-np.pi / 4], RADIUS, between=([0.0, 0.0, 1.5], [6.0, 6.0, 1.5])
    )
    course = plan_optimal_course(gates, FREE, ((6, Effort(10)),))
    v = course.spline.gates[1, 1, :2]
    assert np.rad2deg(np.arctan2(v[1], v[0])) == pytest.approx(15.0, abs=1.0)


@pytest.mark.parametrize(
    "place, changes",
    [
        ([6.0, 0.0, 0.1], {}),  # below the least height
        ([6.0, 0.0, 2.0], {"pylons": np.array([[6.0, 0.0]]), "clearance": 0.6}),
    ],
)
def test_a_gate_that_cannot_be_reached_is_refused(place, changes):
    gates = balls(np.array([place]), between=(START, [12.0, 0.0, 1.0]))
    with pytest.raises(TrajectoryOptimizationError, match="the best lacks"):
        plan_optimal_course(gates, dc.replace(FREE, **changes), ((6, Effort(10)),))


def test_a_short_leg_beside_a_long_one():
    gates = balls(np.array([[1.0, 0.0, 1.0]]), between=(START, [100.0, 0.0, 1.0]))
    course = plan_optimal_course(gates, FREE, ((6, Effort(10)),))
    assert course.bound < course.duration < 1.2 * course.bound


def test_a_thrust_that_turns_over_at_a_point_is_refused():
    gates = balls(np.zeros((0, 3)), between=(START, [0.0, 0.0, 1.5]))
    with pytest.raises(TrajectoryOptimizationError, match="turns over"):
        plan_optimal_course(gates, FREE)
