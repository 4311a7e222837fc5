"""Time allocation: within the limits, touching them, and hard to improve."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RollPitchYaw

from airrace.track import load_track
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.gate_regions import turn_per_lap
from airrace.trajopt.min_snap.limits import peak_speed_and_acceleration
from airrace.trajopt.min_snap.min_snap import DerivativeConstraint, MinSnapProblem, solve_min_snap
from airrace.trajopt.min_snap.time_allocation import allocate_times, durations_within_limits

NAN = np.nan
LIMITS = dict(max_speed=20.0, max_acceleration=10.0)
few = settings(max_examples=10)
seeds = st.integers(0, 10**6)


@pytest.fixture(scope="module")
def midpoints():
    return np.array([gate.p_WG for gate in load_track("student-airrace").gates])


def shortest(waypoints, durations, *, max_speed, max_acceleration, min_factor=0.7, **options):
    problem = MinSnapProblem(waypoints, **options)
    limits = [max_speed, max_acceleration]
    return durations_within_limits(problem, durations, limits, min_factor=min_factor)


def make_waypoints(seed, periodic=True):
    """Returns the midpoints of random gates around a loop, (m, 3)."""
    rng = np.random.default_rng(seed)
    m = int(rng.integers(4, 8))
    angle = 2 * np.pi * (np.arange(m) + rng.uniform(-0.3, 0.3, m)) / m
    radius = rng.uniform(20, 60, m)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), rng.uniform(3, 9, m)])


def rest(orders=(1, 2, 3)):
    return [DerivativeConstraint(i, k, np.zeros(3)) for i in (0, -1) for k in orders]


def chords(waypoints):
    return np.linalg.norm(np.roll(waypoints, -1, axis=0) - waypoints, axis=1)


def assert_touches(trajectory, max_speed=20.0, max_acceleration=10.0):
    speed, acceleration = peak_speed_and_acceleration(trajectory)
    assert speed <= max_speed * (1 + 1e-9) and acceleration <= max_acceleration * (1 + 1e-9)
    assert max(speed / max_speed, acceleration / max_acceleration) > 1 - 1e-6


@few
@given(seeds)
def test_no_sample_is_beyond_the_peaks(seed):
    waypoints = make_waypoints(seed)
    p = solve_min_snap(waypoints, chords(waypoints) / 12, periodic=True)
    times = np.linspace(0.0, p.end_time(), 20001)
    for k, peak in enumerate(peak_speed_and_acceleration(p), 1):
        dense = np.linalg.norm(p.derivative(k).vector_values(times), axis=0).max()
        assert dense <= peak * (1 + 1e-9)
        assert peak == pytest.approx(dense, rel=1e-6)


def test_peaks_of_rest_to_rest():
    constraints = [DerivativeConstraint(i, k, np.zeros(4)) for i in (0, -1) for k in (1, 2, 3)]
    # Yaw, the fourth row, counts for neither.
    p = solve_min_snap([[0, 0, 0, 0], [3, 4, 12, 99]], [2.0], constraints=constraints)
    speed, acceleration = peak_speed_and_acceleration(p)
    assert speed == pytest.approx(13 * 35 / 16 / 2, rel=1e-9)
    assert acceleration == pytest.approx(13 * 84 / 5**1.5 / 4, rel=1e-9)


@few
@given(seeds, st.floats(1.0, 30.0), st.floats(1.0, 30.0))
def test_exact_scaling(seed, max_speed, max_acceleration):
    waypoints = make_waypoints(seed)
    guess = chords(waypoints) / 100
    limits = dict(max_speed=max_speed, max_acceleration=max_acceleration)
    durations = shortest(waypoints, guess, periodic=True, **limits)
    np.testing.assert_allclose(durations / guess, durations[0] / guess[0])
    assert_touches(solve_min_snap(waypoints, durations, periodic=True), **limits)
    # A time that is long enough is shortened, but not below min_factor.
    np.testing.assert_allclose(
        shortest(waypoints, 1.2 * durations, periodic=True, **limits), durations, rtol=1e-7
    )
    np.testing.assert_allclose(
        shortest(waypoints, 1.2 * durations, periodic=True, min_factor=0.95, **limits),
        1.14 * durations,
    )


@few
@given(seeds, st.floats(0.0, 15.0))
def test_searched_scaling(seed, speed):
    waypoints = make_waypoints(seed)
    ahead = (waypoints[1] - waypoints[0]) / np.linalg.norm(waypoints[1] - waypoints[0])
    constraints = [
        DerivativeConstraint(0, 1, speed * ahead),
        DerivativeConstraint(0, 2, 0.1 * ahead),
        *rest()[3:],
    ]
    guess = chords(waypoints)[:-1] / 10
    options = dict(constraints=constraints, **LIMITS)
    durations = shortest(waypoints, guess, min_factor=0.3, **options)
    assert_touches(solve_min_snap(waypoints, durations, constraints=constraints))
    again = shortest(waypoints, durations, min_factor=1.0, **options)
    np.testing.assert_allclose(again, durations, rtol=1e-6)


def test_no_scale_is_enough():
    # It flies away from the goal, at the limit.
    constraints = [DerivativeConstraint(0, 1, [-20, 0, 0]), DerivativeConstraint(0, 2, [-5, 0, 0])]
    options = dict(constraints=constraints + rest((1, 2))[2:], **LIMITS)
    for find in (lambda **o: shortest(durations=[2.0], **o), allocate_times):
        with pytest.raises(TrajectoryOptimizationError, match="relax"):
            find(waypoints=[[0, 0, 5], [40, 0, 5]], **options)


def test_reference_track(midpoints):
    equal_speeds = shortest(midpoints, chords(midpoints) / 20, periodic=True, **LIMITS)
    assert equal_speeds.sum() == pytest.approx(27.23, abs=0.01)
    durations = allocate_times(midpoints, periodic=True, **LIMITS)
    assert durations.sum() < 21.99
    assert_touches(solve_min_snap(midpoints, durations, periodic=True))


def test_reference_track_with_yaw(midpoints):
    headings = [gate.heading for gate in load_track("student-airrace").gates]
    waypoints = np.column_stack([midpoints, np.unwrap(headings)])
    offset = [0, 0, 0, turn_per_lap(headings)]
    assert offset[3] == pytest.approx(2 * np.pi)
    options = dict(periodic=True, period_offset=offset)
    durations = allocate_times(waypoints, **options, **LIMITS)
    assert durations.sum() < 21.99
    p = solve_min_snap(waypoints, durations, **options)
    assert_touches(p)
    np.testing.assert_allclose(p.value(p.end_time()) - p.value(0), np.c_[offset], atol=1e-9)


def test_reference_track_level_at_the_gates(midpoints):
    constraints = [DerivativeConstraint(i, 2, [0, 0, NAN]) for i in range(len(midpoints))]
    options = dict(constraints=constraints, periodic=True)
    durations = allocate_times(midpoints, **options, **LIMITS)
    assert durations.sum() < 31.0  # 29.97 s in the best local minimum known
    p = solve_min_snap(midpoints, durations, **options)
    assert_touches(p)
    gates = p.derivative(2).vector_values(p.get_segment_times())
    np.testing.assert_allclose(gates[:2], 0.0, atol=1e-9)


def test_restarts_leave_a_poor_local_minimum():
    waypoints = make_waypoints(0)
    constraints = [DerivativeConstraint(i, 2, [0, 0, NAN]) for i in range(len(waypoints))]
    options = dict(constraints=constraints, periodic=True, **LIMITS)
    best = allocate_times(waypoints, **options)
    once = allocate_times(waypoints, initial_durations=chords(waypoints) / 15, **options)
    assert best.sum() < 0.99 * once.sum()


@few
@given(seeds)
def test_it_is_a_local_minimum(seed):
    waypoints = make_waypoints(seed)
    durations = allocate_times(waypoints, periodic=True, **LIMITS)
    assert_touches(solve_min_snap(waypoints, durations, periodic=True))
    rng = np.random.default_rng(seed)
    for size in (0.5, 0.1, 0.01):
        other = durations * np.exp(size * rng.normal(size=len(durations)))
        other = shortest(waypoints, other, periodic=True, min_factor=0.1, **LIMITS)
        assert other.sum() > durations.sum() * (1 - 1e-4)


@few
@given(seeds, st.floats(0.2, 5.0), st.floats(-3, 3))
def test_scaled_and_rotated_limits_and_tracks(seed, s, angle):
    waypoints = make_waypoints(seed)
    durations = allocate_times(waypoints, periodic=True, **LIMITS)
    R = RollPitchYaw(angle, angle / 2, -angle).ToRotationMatrix().matrix()
    slower = allocate_times(
        waypoints @ R.T, max_speed=20 / s, max_acceleration=10 / s**2, periodic=True
    )
    np.testing.assert_allclose(slower.sum(), s * durations.sum(), rtol=1e-4)
    larger = allocate_times(
        s * waypoints + 7.0, max_speed=20 * s, max_acceleration=10 * s, periodic=True
    )
    np.testing.assert_allclose(larger.sum(), durations.sum(), rtol=1e-4)


def test_it_is_deterministic_and_warm_starts_agree():
    waypoints = make_waypoints(5)
    durations = allocate_times(waypoints, periodic=True, **LIMITS)
    np.testing.assert_array_equal(durations, allocate_times(waypoints, periodic=True, **LIMITS))
    guess = 2 * durations * np.linspace(0.7, 1.3, len(durations))
    warm = allocate_times(waypoints, periodic=True, initial_durations=guess, **LIMITS)
    assert warm.sum() == pytest.approx(durations.sum(), rel=1e-4)


@pytest.mark.parametrize("distance", [1.0, 100.0])
def test_rest_to_rest_on_a_line(distance):
    waypoints = distance * np.array([[0, 0, 0], [0.6, 0.0, 0.8]])
    durations = allocate_times(waypoints, constraints=rest(), **LIMITS)
    least = max(35 / 16 * distance / 20, np.sqrt(84 / 5**1.5 * distance / 10))
    assert durations == pytest.approx([least], rel=1e-6)


@few
@given(seeds)
def test_open_trajectory_from_flight_to_rest(seed):
    waypoints = make_waypoints(seed)
    velocity = 0.2 * (waypoints[1] - waypoints[-1])
    velocity *= min(1.0, 15 / np.linalg.norm(velocity))
    constraints = [DerivativeConstraint(0, 1, velocity), *rest()[3:]]
    durations = allocate_times(waypoints, constraints=constraints, **LIMITS)
    assert_touches(solve_min_snap(waypoints, durations, constraints=constraints))
    guess = shortest(
        waypoints, chords(waypoints)[:-1] / 10, constraints=constraints, min_factor=0.2, **LIMITS
    )
    assert durations.sum() < guess.sum()


@pytest.mark.parametrize("first", [0, 4, 8])
def test_hand_over_from_lap_to_lap_is_as_fast_as_the_lap(midpoints, first):
    # The lap keeps a reserve, from which the way between moved gates is flown.
    lap_durations = allocate_times(midpoints, periodic=True, max_speed=19.8, max_acceleration=9.9)
    lap = solve_min_snap(midpoints, lap_durations, periodic=True)
    gates = (first + np.arange(4)) % 10
    waypoints = midpoints[gates]
    waypoints[1:-1] += np.random.default_rng(first).normal(scale=0.2, size=(2, 3))
    constraints = [
        DerivativeConstraint(i, k, lap.EvalDerivative(lap.get_segment_times()[gates[i]], k).ravel())
        for i in (0, -1)
        for k in (1, 2, 3)
    ]
    durations = allocate_times(waypoints, constraints=constraints, **LIMITS)
    assert durations.sum() < 1.01 * lap_durations[gates[:-1]].sum()
    assert_touches(solve_min_snap(waypoints, durations, constraints=constraints))


def test_a_useless_warm_start_does_no_harm():
    waypoints = make_waypoints(4)
    velocity = DerivativeConstraint(0, 1, 0.3 * (waypoints[1] - waypoints[0]))
    options = dict(constraints=[velocity, *rest()[3:]], **LIMITS)
    cold = allocate_times(waypoints, **options)
    warm = allocate_times(waypoints, initial_durations=50.0 + 0.0 * cold, **options)
    assert_touches(solve_min_snap(waypoints, warm, constraints=options["constraints"]))


def test_planar_trajectories_work_too():
    waypoints = make_waypoints(2)[:, :2]
    durations = allocate_times(waypoints, periodic=True, **LIMITS)
    assert_touches(solve_min_snap(waypoints, durations, periodic=True))


SQUARE = 20.0 * np.array([[0, 0, 0.2], [1, 0, 0.2], [1, 1, 0.2], [0, 1, 0.2]])
BAD = {
    "must be positive": dict(max_speed=0.0),
    "must be positive.*nan": dict(max_acceleration=NAN),
    "positive, not": dict(max_speed=np.inf),
    "coincide": dict(waypoints=SQUARE[[0, 1, 1, 2]]),
    "Durations must be 4": dict(initial_durations=[1.0, 1.0]),
    "positive and finite": dict(initial_durations=[1.0, 1.0, -1.0, 1.0]),
    "fixed above its limit": dict(constraints=[DerivativeConstraint(2, 1, [NAN, 15.0, 15.0])]),
    "waypoint 7 of": dict(constraints=[DerivativeConstraint(7, 1, np.zeros(3))]),
    "degree must be odd": dict(degree=6),
    "shape": dict(waypoints=[1.0, 2.0, 3.0]),
    "not unique": dict(waypoints=SQUARE[:2], periodic=False),
    "unique": dict(
        waypoints=SQUARE[:2],
        periodic=False,
        constraints=[DerivativeConstraint(0, 1, [1.0, 0.0, 0.0])],
    ),
}


@pytest.mark.parametrize("message", BAD)
def test_bad_input_is_one_clear_error(message):
    with pytest.raises(ValueError, match=f"(?i){message}"):
        allocate_times(**(dict(waypoints=SQUARE, periodic=True) | LIMITS | BAD[message]))


def test_waypoints_that_differ_in_yaw_alone_take_no_time():
    turn = np.array([[0, 0, 5, 0], [0, 0, 5, 1.0]])
    with pytest.raises(ValueError, match="coincide"):
        allocate_times(turn, constraints=[], **LIMITS)
    constraints = [DerivativeConstraint(i, k, np.zeros(4)) for i in (0, -1) for k in (1, 2, 3)]
    durations = shortest(turn, [2.0], constraints=constraints, **LIMITS)
    assert durations == pytest.approx([0.7 * 2.0])
