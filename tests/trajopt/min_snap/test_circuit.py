"""The lap through the gates: closed, forward, within the limits, and fair."""

import functools
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from airrace.track import PYLON_HEIGHT, load_track
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.feasibility import check_flight
from airrace.trajopt.flat_trajectory import segment_coefficients
from airrace.trajopt.flatness import attitude_from_force, heading_vectors
from airrace.trajopt.flight_limits import FlightConstraints, FlightLimits
from airrace.trajopt.min_snap.circuit import REST_BEYOND, LapStyle, plan_circuit
from airrace.trajopt.reference import as_reference
from airrace.vehicle import GRAVITY, load_vehicle
from tests.worlds import cases

TRACK = load_track("student-airrace")
MIDPOINTS = np.array([gate.p_WG for gate in TRACK.gates])
HEADINGS = np.array([gate.heading for gate in TRACK.gates])
LIMITS = dict(
    clearance=2.0,
    limits=FlightLimits(load_vehicle("Default")[0], max_speed=20.0, max_acceleration=10.0),
)
each = pytest.mark.parametrize("dimensions", [3, 4, 6])
few = settings(max_examples=8)


def pylons_of(midpoints, headings, spacing=10.0):
    right = spacing / 2 * np.column_stack([np.sin(headings), -np.cos(headings)])
    return np.vstack([midpoints[:, :2] - right, midpoints[:, :2] + right])


def plan(midpoints, headings, dimensions, **kwargs):
    pylons = pylons_of(np.array(midpoints), np.array(headings))
    constraints = FlightConstraints(pylons, **LIMITS)
    return plan_circuit(midpoints, headings, dimensions, constraints, **kwargs)


@functools.cache
def reference(dimensions):
    return plan(MIDPOINTS, HEADINGS, dimensions)


def moved(seed, distance=0.3):
    """Returns the track student-airrace as a poor map has it."""
    rng = np.random.default_rng(seed)
    step = rng.normal(size=MIDPOINTS.shape)
    step *= distance / np.linalg.norm(step, axis=1, keepdims=True)
    return MIDPOINTS + step, HEADINGS + rng.normal(scale=0.03, size=len(HEADINGS))


def square(turned=None, by=0.0, side=40.0):
    """Returns four gates on the sides of a square; the heading of one is turned."""
    headings = np.pi / 2 * np.arange(4)
    out = np.column_stack([np.sin(headings), -np.cos(headings), np.zeros(4)])
    if turned is not None:
        headings[turned] += by
    return side / 2 * out + [0.0, 0.0, 6.0], headings


def dense(trajectory, rate=1000):
    return trajectory.sample(np.linspace(0.0, trajectory.duration, int(rate * trajectory.duration)))


def assert_raceable(circuit, midpoints, headings):
    """Checks anew, and finer, all that a lap promises."""
    d = np.array([circuit.derivatives(t) for t in circuit.gate_times])
    np.testing.assert_allclose(d[:, 0, :3], np.vstack([midpoints, midpoints[:1]]), atol=1e-8)
    heading = np.append(headings, headings[0])
    forward = np.column_stack([np.cos(heading), np.sin(heading), np.zeros(len(heading))])
    speed = np.linalg.norm(d[:, 1, :3], axis=1)
    assert np.all(np.sum(forward * d[:, 1, :3], axis=1) > 0.5 * speed)
    samples = dense(circuit)
    assert np.linalg.norm(as_reference(samples).velocity, axis=0).max() <= 20.0
    assert np.linalg.norm(as_reference(samples).acceleration, axis=0).max() <= 10.0
    assert 1.0 < samples[2].min() and samples[2].max() < PYLON_HEIGHT
    pylons = pylons_of(np.array(midpoints), np.array(headings))
    distances = np.linalg.norm(samples[:2, :, None] - pylons.T[:, None], axis=0)
    assert distances.min() > 1.99


@pytest.mark.slow
@each
def test_the_reference_track(dimensions):
    assert_raceable(reference(dimensions), MIDPOINTS, HEADINGS)


@pytest.mark.parametrize("dimensions, longest", [(3, 22.5), (4, 23.0), (6, 32.0)])
def test_it_is_fast_and_the_limits_are_used(dimensions, longest):
    circuit = reference(dimensions)
    # The point-mass bound through the midpoints, see the reference.
    assert 20.75 < circuit.duration < longest
    assert np.linalg.norm(as_reference(dense(circuit)).velocity, axis=0).max() > 19.5
    assert np.linalg.norm(as_reference(dense(circuit)).acceleration, axis=0).max() > 9.8


@each
def test_gate_times(dimensions):
    circuit = reference(dimensions)
    assert circuit.gate_times[0] == 0.0 and circuit.gate_times[-1] == circuit.duration
    assert len(circuit.gate_times) == len(MIDPOINTS) + 1
    assert np.all(np.diff(circuit.gate_times) > 0)
    assert set(circuit.gate_times) <= set(circuit.breaks)
    assert len(circuit.breaks) == len(circuit.gate_times) + len(circuit.approach)


@each
def test_it_is_smooth_through_snap_all_around(dimensions):
    circuit = reference(dimensions)
    for t in circuit.breaks[1:-1]:
        before, after = circuit.derivatives(t - 1e-9), circuit.derivatives(t + 1e-9)
        np.testing.assert_allclose(before, after, atol=1e-5)
    turn = np.zeros((5, 4))
    turn[0, 3] = 0.0 if dimensions == 3 else 2 * np.pi
    seam = circuit.derivatives(circuit.duration) - circuit.derivatives(0.0)
    np.testing.assert_allclose(seam, turn, atol=1e-7)


@each
def test_yaw(dimensions):
    circuit = reference(dimensions)
    yaw = as_reference(circuit.sample(circuit.gate_times)).yaw
    if dimensions == 3:
        *_, yaw, rate, acceleration = as_reference(dense(circuit))
        np.testing.assert_allclose(yaw, HEADINGS[0], rtol=0.0, atol=1e-12)
        np.testing.assert_allclose([rate, acceleration], 0.0, atol=1e-12)
    else:
        expected = np.unwrap([*HEADINGS, HEADINGS[0]])
        np.testing.assert_allclose(yaw, expected, atol=1e-9)
        # It turns with the track, never wildly.
        assert np.abs(as_reference(dense(circuit)).yaw_rate).max() < 2.0


def tilts_at_gates(circuit):
    """Returns the angle between body z and world z at the gates (rad)."""
    s = circuit.sample(circuit.gate_times)
    r = as_reference(s)
    heading = heading_vectors(np.cos(r.yaw), np.sin(r.yaw), r.yaw_rate, r.yaw_acceleration)
    force = r.acceleration + np.array([[0.0], [0.0], [GRAVITY]])
    axes, _, _ = attitude_from_force(force, r.jerk, r.snap, heading)
    return np.arccos(np.clip(axes[2][2], -1.0, 1.0))


def test_roll_and_pitch_are_zero_at_the_gates_in_six_dimensions_only():
    np.testing.assert_allclose(tilts_at_gates(reference(6)), 0.0, atol=1e-6)
    for dimensions in (3, 4):
        assert np.median(tilts_at_gates(reference(dimensions))) > 0.3


def test_three_and_four_dimensions_fly_the_same_path():
    np.testing.assert_allclose(
        as_reference(dense(reference(3))).position,
        as_reference(dense(reference(4))).position,
        atol=1e-6,
    )


@pytest.mark.slow
@few
@given(st.floats(-np.pi, np.pi), st.floats(-500, 500), st.sampled_from([3, 4]), st.booleans())
def test_it_does_not_matter_where_the_track_lies(angle, shift, dimensions, mirrored):
    c, s = np.cos(angle), np.sin(angle)
    midpoints, headings = MIDPOINTS.copy(), HEADINGS
    if mirrored:
        midpoints[:, 1] *= -1
        headings = -headings
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    midpoints = midpoints @ turn.T + [shift, -shift / 2, 0]
    circuit = plan(midpoints, headings + angle, dimensions)
    assert circuit.duration == pytest.approx(reference(dimensions).duration, rel=1e-4)
    assert_raceable(circuit, midpoints, headings + angle)


@pytest.mark.slow
def test_it_does_not_matter_where_a_level_track_lies():
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    circuit = plan(MIDPOINTS @ turn.T + [7.0, -3.0, 0.0], HEADINGS + np.pi / 2, 6)
    # The search for the best of many local minima is not symmetric.
    assert circuit.duration == pytest.approx(reference(6).duration, rel=0.03)


@few
@given(st.integers(1, 9))
def test_it_does_not_matter_which_gate_comes_first(first):
    circuit = plan(np.roll(MIDPOINTS, -first, axis=0), np.roll(HEADINGS, -first), 4)
    assert circuit.duration == pytest.approx(reference(4).duration, rel=1e-4)
    legs = np.diff(reference(4).gate_times)
    np.testing.assert_allclose(np.diff(circuit.gate_times), np.roll(legs, -first), atol=0.02)


@given(st.lists(st.integers(-2, 2), min_size=10, max_size=10))
@few
def test_full_turns_of_a_heading_do_not_matter(turns):
    circuit = plan(MIDPOINTS, HEADINGS + 2 * np.pi * np.array(turns), 4)
    ours, expected = (as_reference(dense(each)) for each in (circuit, reference(4)))
    for part in set(ours._fields) - {"yaw"}:
        np.testing.assert_allclose(getattr(ours, part), getattr(expected, part), atol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("seed", cases.first(range(10)))
def test_moved_gates(seed):
    midpoints, headings = moved(seed)
    for dimensions, longest in ((3, 23.0), (6, 32.5)):
        circuit = plan(midpoints, headings, dimensions)
        assert_raceable(circuit, midpoints, headings)
        assert circuit.duration < longest
        warm = plan(midpoints, headings, dimensions, previous=reference(dimensions))
        assert_raceable(warm, midpoints, headings)
        assert warm.duration < circuit.duration * (1.0001 if dimensions == 3 else 1.03)


@each
def test_a_lap_from_itself_is_as_short(dimensions):
    previous = reference(dimensions)  # not by the clock: the first test that asks for it plans it
    clock = time.process_time()
    again = plan(MIDPOINTS, HEADINGS, dimensions, previous=previous)
    assert again.duration <= previous.duration * (1 + 1e-6)
    assert again.approach == previous.approach
    assert time.process_time() - clock < 1.0


def test_a_lap_from_one_of_another_track_is_as_short():
    for other in (square(), square(0, 1.4)):  # fewer gates, and one that asks for an approach
        previous = plan(*other, 4)
        assert plan(MIDPOINTS, HEADINGS, 4, previous=previous).duration == pytest.approx(
            reference(4).duration, rel=1e-4
        )
    # As many gates, but no use at all.
    far = plan(*square(side=1000.0), 4)
    assert plan(*square(), 4, previous=far).duration == pytest.approx(
        plan(*square(), 4).duration, rel=1e-3
    )


@pytest.mark.slow
@pytest.mark.parametrize("turned", cases.first(range(4)))
@pytest.mark.parametrize("by", [-1.4, 1.4])
@each
def test_a_gate_askew_gets_a_waypoint_in_front_of_it(turned, by, dimensions):
    midpoints, headings = square(turned, by)
    circuit = plan(midpoints, headings, dimensions)
    assert_raceable(circuit, midpoints, headings)
    assert turned in circuit.approach
    assert len(circuit.breaks) == len(circuit.gate_times) + len(circuit.approach)
    for i, distance in circuit.approach.items():
        t = max(t for t in circuit.breaks if t < circuit.gate_times[i or len(headings)])
        pose = circuit.derivatives(t)[0]
        forward = np.array([np.cos(headings[i]), np.sin(headings[i]), 0.0])
        np.testing.assert_allclose(pose[:3], midpoints[i] - distance * forward, atol=1e-8)
        if dimensions != 3:
            assert np.cos(pose[3] - headings[i]) == pytest.approx(1.0)


def test_a_larger_drone_takes_a_turned_gate_straighter():
    midpoints, headings = square(2, 1.0)
    pylons = pylons_of(midpoints, headings)
    laps = {
        clearance: plan_circuit(
            midpoints, headings, 3, FlightConstraints(pylons, **{**LIMITS, "clearance": clearance})
        )
        for clearance in (2.0, 2.4)
    }
    for clearance, lap in laps.items():
        distances = np.linalg.norm(dense(lap)[:2, :, None] - pylons.T[:, None], axis=0)
        assert distances.min() > clearance - 0.01
    assert laps[2.0].approach == {} and 2 in laps[2.4].approach
    assert laps[2.0].duration < laps[2.4].duration


@each
def test_a_wide_gate_is_crossed_forward_although_no_pylon_says_so(dimensions):
    midpoints, headings = square(2, 1.4, side=80.0)
    circuit = plan_circuit(
        midpoints,
        headings,
        dimensions,
        FlightConstraints(pylons_of(midpoints, headings, 40.0), **LIMITS),
    )
    velocity = np.array([circuit.derivatives(t)[1, :3] for t in circuit.gate_times[:-1]])
    along = velocity[:, 0] * np.cos(headings) + velocity[:, 1] * np.sin(headings)
    assert np.all(along > 0.5 * np.linalg.norm(velocity, axis=1))


def test_straight_gates_get_none():
    assert plan(*square(), 4).approach == {}


def test_two_gates_are_enough():
    midpoints, headings = np.array([[0, 30, 6.0], [0, -30, 6.0]]), np.array([np.pi, 0.0])
    assert_raceable(plan(midpoints, headings, 4), midpoints, headings)


def impossible():
    midpoints, headings = square()
    pylons = pylons_of(midpoints, headings)
    wall = [[x, y] for x in (-3, 0, 3) for y in range(-40, 41, 2)]
    nan, low, twice = midpoints.copy(), midpoints.copy(), midpoints.copy()
    nan[1, 2], low[2, 2], twice[2] = np.nan, 0.5, twice[1]
    return {
        "no gates": (np.zeros((0, 3)), [], pylons),
        "one gate": (midpoints[:1], headings[:1], pylons),
        "not a number": (nan, headings, pylons),
        "heading not a number": (midpoints, [0.0, np.nan, 0.0, 0.0], pylons),
        "a gate near the ground": (low, headings, pylons),
        "one gate twice": (twice, headings, pylons),
        "a pylon in a gate": (midpoints, headings, [*pylons, midpoints[3, :2]]),
        "a wall of pylons": (midpoints, headings, wall),
    }


@pytest.mark.parametrize("case", impossible())
@pytest.mark.parametrize("dimensions", [3, 6])
def test_impossible_laps_are_refused_in_time(case, dimensions):
    clock = time.process_time()
    with pytest.raises(TrajectoryOptimizationError):
        midpoints, headings, pylons = impossible()[case]
        plan_circuit(midpoints, headings, dimensions, FlightConstraints(pylons, **LIMITS))
    assert time.process_time() - clock < 20.0


@few
@given(st.floats(0.3, 3.0))
def test_limits_scale(s):
    """Slower by s, at accelerations less by s squared, a lap takes s as long."""
    circuit = plan_circuit(
        MIDPOINTS,
        HEADINGS,
        3,
        FlightConstraints(
            pylons_of(MIDPOINTS, HEADINGS),
            2.0,
            FlightLimits(
                load_vehicle("Default")[0],
                thrust_share=1e3,  # any thrust, from above and below
                idle_share=-1e3,
                max_rate=1e3,
                max_speed=20 / s,
                max_acceleration=10 / s**2,
            ),
        ),
    )
    assert circuit.duration == pytest.approx(s * reference(3).duration, rel=1e-4)


@pytest.mark.slow
def test_faults_that_move_from_gate_to_gate():
    """With a waypoint in front of the faulty gates, another one becomes faulty here."""
    gates = np.array(
        [
            [12.99, -19.89, 75],
            [18.8, 7.76, 120],
            [10.22, 19.69, 75],
            [15.13, 43.67, 30],
            [33.15, 55.76, -15],
            [67.07, 48.19, -60],
            [75.35, 36.77, -105],
            [61.76, -19.63, -60],
            [78.84, -46.29, -105],
            [72.6, -75.22, -60],
            [89.24, -101.12, -105],
            [80.23, -140.39, -150],
            [43.18, -163.48, 165],
            [25.92, -160.37, 120],
            [13.76, -142.25, 75],
            [25.5, -92.78, 120],
            [14.24, -76.19, 75],
            [23.83, -34.74, 120],
        ]
    )
    midpoints = np.column_stack([gates[:, :2], np.full(len(gates), 6.25)])
    circuit = plan(midpoints, np.deg2rad(gates[:, 2]), 6)
    assert 50.0 < circuit.duration < 60.0 and len(circuit.approach) > 2


RESTING = {"exact": LapStyle(rests=True), "soft": LapStyle(rests=True, soft=True)}
FORWARD = np.array([np.cos(HEADINGS[0]), np.sin(HEADINGS[0]), 0.0])


@functools.cache
def resting(dimensions, kind):
    return plan(MIDPOINTS, HEADINGS, dimensions, style=RESTING[kind])


@pytest.mark.slow
@pytest.mark.parametrize("kind", RESTING)
@each
def test_a_lap_from_rest_to_rest(dimensions, kind):
    circuit = resting(dimensions, kind)
    assert circuit.rests
    # Just beyond gate 1, with its heading, all derivatives through the snap are zero.
    ends = circuit.derivatives(0.0), circuit.derivatives(circuit.duration)
    for d in ends:
        np.testing.assert_allclose(d[0, :3], MIDPOINTS[0] + REST_BEYOND * FORWARD, atol=1e-8)
        assert np.cos(d[0, 3] - HEADINGS[0]) == pytest.approx(1.0)
        np.testing.assert_allclose(d[1:], 0.0, atol=1e-6)
    assert ends[1][0, 3] - ends[0][0, 3] == pytest.approx(2 * np.pi * (dimensions > 3))
    for t in circuit.breaks[1:-1]:
        before, after = circuit.derivatives(t - 1e-9), circuit.derivatives(t + 1e-9)
        np.testing.assert_allclose(before, after, atol=1e-5)
    # Polynomials of ten coefficients, from waypoint to waypoint.
    pieces = segment_coefficients(circuit.polynomial)
    assert pieces.shape == (len(MIDPOINTS) + len(circuit.approach), 4, 10)
    # It passes gate 1 a little before it rests, and the others at their midpoints.
    times = np.array(circuit.gate_times)
    assert times[0] + circuit.duration == pytest.approx(times[-1])
    assert np.all(np.diff(times) > 0.0) and -2.0 < times[0] < -0.3
    d = np.array([circuit.derivatives(t) for t in times[1:]])
    np.testing.assert_allclose(d[:-1, 0, :3], MIDPOINTS[1:], atol=1e-8)
    assert FORWARD @ (d[-1, 0, :3] - MIDPOINTS[0]) == pytest.approx(0.0, abs=1e-6)
    assert np.linalg.norm(d[-1, 0, :3] - MIDPOINTS[0]) < 0.6
    assert 0.5 < np.linalg.norm(d[-1, 1, :3]) < 4.0 and d[-1, 1, :3] @ FORWARD > 0.3
    if dimensions == 6 and kind == "exact":
        np.testing.assert_allclose(tilts_at_gates(circuit)[1:-1], 0.0, atol=1e-6)
    samples = dense(circuit)
    pylons = pylons_of(MIDPOINTS, HEADINGS)
    distances = np.linalg.norm(samples[:2, :, None] - pylons.T[:, None], axis=0)
    assert distances.min() > 1.99 and samples[2].min() > 1.0
    speed = np.linalg.norm(as_reference(samples).velocity, axis=0).max()
    acceleration = np.linalg.norm(as_reference(samples).acceleration, axis=0).max()
    if dimensions == 3 and kind == "soft":
        assert 20.0 < speed < 22.0 and 10.0 < acceleration < 11.0
    else:
        assert speed <= 20.0 and acceleration <= 10.0
        assert speed > 19.5 or acceleration > 9.8


@pytest.mark.slow
def test_laps_of_the_original_system_last_as_long_as_in_its_report():
    """40.60, 41.52 and 41.21 s, mean of ten laps on maps of its own."""
    assert resting(3, "soft").duration == pytest.approx(40.60, rel=0.01)
    assert resting(4, "soft").duration == pytest.approx(41.52, rel=0.01)
    assert resting(6, "soft").duration == resting(4, "soft").duration


@pytest.mark.slow
@each
def test_to_rest_takes_time_and_so_do_soft_limits(dimensions):
    exact, soft = (resting(dimensions, kind).duration for kind in RESTING)
    assert reference(dimensions).duration < exact < soft
    again = plan(
        *(MIDPOINTS, HEADINGS, dimensions),
        style=RESTING["exact"],
        previous=resting(dimensions, "exact"),
    )
    assert again.duration <= exact * (1 + 1e-6) and again.approach == {0: REST_BEYOND}


@pytest.mark.slow
@pytest.mark.parametrize("kind", RESTING)
def test_a_lap_from_rest_to_rest_lies_anywhere(kind):
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    midpoints = MIDPOINTS @ turn.T + [7.0, -3.0, 0.0]
    circuit = plan(midpoints, HEADINGS + np.pi / 2, 4, style=RESTING[kind])
    assert circuit.duration == pytest.approx(resting(4, kind).duration, rel=1e-3)
    # At any gate: also where the last leg comes from straight ahead.
    for first in (3, 6, 9):
        order = np.roll(np.arange(len(MIDPOINTS)), -first)
        circuit = plan(MIDPOINTS[order], HEADINGS[order], 4, style=RESTING[kind])
        velocity = circuit.derivatives(circuit.gate_times[-1])[1, :3]
        heading = HEADINGS[first]
        assert velocity @ [np.cos(heading), np.sin(heading), 0.0] > 0.0


@pytest.mark.slow
def test_soft_limits_are_those_of_speed_and_acceleration_alone():
    vehicle, _ = load_vehicle("Default")
    pylons = pylons_of(MIDPOINTS, HEADINGS)

    def soft(clearance=2.0, **limits):
        limits = FlightLimits(vehicle, max_speed=20.0, max_acceleration=10.0, **limits)
        constraints = FlightConstraints(pylons, clearance, limits)
        circuit = plan_circuit(MIDPOINTS, HEADINGS, 3, constraints, style=RESTING["soft"])
        check = check_flight(dense(circuit), pylons, limits)
        assert check.clearance >= clearance - 0.01
        return circuit, check

    usual, _ = soft()
    weak, check = soft(thrust_share=0.35)
    assert weak.duration > 1.01 * usual.duration
    assert max(check.max_thrusts) <= 0.35 * vehicle.max_thrusts[0] * (1 + 1e-4)
    # Where the usual one comes too near to a pylon, it is another lap, or none.
    wider, _ = soft(clearance=2.8)
    assert wider.approach and not usual.approach
    with pytest.raises(TrajectoryOptimizationError, match="clear of all pylons"):
        soft(clearance=5.1)


@pytest.mark.slow
def test_soft_laps_do_not_start_from_the_lap_before():
    """The same map gives the same lap, whatever was flown before."""
    wider = FlightConstraints(pylons_of(MIDPOINTS, HEADINGS), **{**LIMITS, "clearance": 2.8})
    previous = plan_circuit(MIDPOINTS, HEADINGS, 3, wider, style=RESTING["soft"])
    assert previous.approach == {0: REST_BEYOND}
    again = plan(MIDPOINTS, HEADINGS, 3, style=RESTING["soft"], previous=previous)
    assert again.approach == {} and again.breaks == resting(3, "soft").breaks


def test_a_lap_that_never_stops_does_not_rest():
    assert not reference(3).rests
