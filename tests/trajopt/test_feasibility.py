"""What can be flown, on straight lines whose peaks are known."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pydrake.trajectories import PiecewisePolynomial

from airrace.track import PYLON_HEIGHT
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.feasibility import (
    MAX_CROSSING_ANGLE,
    MAX_DURATION,
    clearance_of,
    is_feasible,
    passes_forward,
    peaks,
    pylon_distances,
    sample_times,
)
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.flight_limits import MIN_HEIGHT, FlightConstraints, FlightLimits
from airrace.trajopt.min_snap.min_snap import DerivativeConstraint, solve_min_snap
from airrace.vehicle import load_vehicle

VEHICLE, _ = load_vehicle("Default")
ANY = dict(thrust_share=1e3, idle_share=-1e3, max_rate=1e3)  # of thrust and rate
LIMITS = dict(
    clearance=2.0, limits=FlightLimits(VEHICLE, max_speed=20.0, max_acceleration=10.0, **ANY)
)
NONE = np.zeros((0, 2))
few = settings(max_examples=40)


def line(start, end, duration):
    """Returns the minimum-snap flight from rest to rest."""
    rest = [DerivativeConstraint(i, k, np.zeros(4)) for i in (0, -1) for k in (1, 2, 3)]
    knots = [[*start, 0.0], [*end, 0.0]]
    return FlatTrajectory(solve_min_snap(knots, [duration], constraints=rest))


def steady(start, velocity, duration=1.0):
    """Returns a flight at constant velocity."""
    knots = np.array([[*start, 0.0], [*(np.array(start) + duration * np.array(velocity)), 0.0]])
    return FlatTrajectory(PiecewisePolynomial.FirstOrderHold([0.0, duration], knots.T))


@few
@given(st.floats(1.0, 100.0), st.floats(1.0, 20.0))
def test_peaks_of_rest_to_rest(distance, duration):
    speed, acceleration = 35 / 16 * distance / duration, 84 / 5**1.5 * distance / duration**2
    trajectory = line([0, 0, 5], [0.6 * distance, -0.8 * distance, 5], duration)
    samples = trajectory.sample(sample_times(trajectory))
    assert peaks(samples) == pytest.approx((speed, acceleration), rel=1e-3)
    assume(abs(speed - 20) > 0.1 and abs(acceleration - 10) > 0.1)
    assert is_feasible(trajectory, FlightConstraints(NONE, **LIMITS)) == (
        speed < 20 and acceleration < 10
    )


@few
@given(st.floats(0.0, 3.0))
def test_height(lowest):
    assume(abs(lowest - MIN_HEIGHT) > 1e-6)
    assert is_feasible(line([0, 0, lowest], [5, 0, 5], 5.0), FlightConstraints(NONE, **LIMITS)) == (
        lowest > MIN_HEIGHT
    )


@few
@given(st.floats(-6, 6), st.floats(1.0, 30.0), st.floats(-np.pi, np.pi), st.floats(0.5, 4.0))
def test_pylons(offset, height, angle, clearance):
    """Past a pylon on either side, or over it."""
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    distance = np.hypot(offset, max(height - PYLON_HEIGHT, 0.0))
    assume(abs(distance - clearance) > 0.01)
    limits = {**LIMITS, "clearance": clearance}
    start, end = turn @ [-10, offset], turn @ [10, offset]
    trajectory = line([*start, height], [*end, height], 8.0)
    distances = pylon_distances(trajectory.sample(sample_times(trajectory)), [[0, 0], [500, 0]])
    assert distances.shape == (len(sample_times(trajectory)), 2)
    assert distances.min() == pytest.approx(distance, abs=1e-3 + 0.05 * (distance < 1))
    assert is_feasible(trajectory, FlightConstraints([[0, 0], [500, 0]], **limits)) == (
        distance > clearance
    )
    assert is_feasible(trajectory, FlightConstraints([[500, 0]], **limits))


def test_the_clearance_grows_with_the_drone():
    default, star_one = (load_vehicle(name)[0].radius for name in ("Default", "StarOne"))
    assert clearance_of(default) == pytest.approx(2.0, abs=0.01)
    assert clearance_of(star_one) - clearance_of(default) == pytest.approx(star_one - default)


def test_height_alone_is_no_fault():
    assert is_feasible(
        line([0, 0, 5], [5, 0, PYLON_HEIGHT + 10], 6.0), FlightConstraints([[30, 0]], **LIMITS)
    )


def test_what_is_not_a_number_cannot_be_flown():
    trajectory = line([0, 0, 5], [5, 0, 5], 5.0)
    nan = FlatTrajectory(PiecewisePolynomial.ZeroOrderHold([0, 1.0], np.full((4, 2), np.nan)))
    assert is_feasible(trajectory, FlightConstraints(NONE, **LIMITS))
    assert not is_feasible(nan, FlightConstraints(NONE, **LIMITS))


@few
@given(st.floats(1e-3, 30.0))
def test_the_check_is_dense_and_has_both_ends(duration):
    times = sample_times(line([0, 0, 5], [5, 0, 5], duration))
    assert times[0] == 0.0 and times[-1] == duration
    assert np.all(np.diff(times) > 0) and np.diff(times).max() <= 0.01 + 1e-12


@few
@given(st.floats(-9, 9), st.floats(-np.pi, np.pi), st.floats(-1.2, 1.2), st.floats(0.5, 20))
def test_passing_forward(heading, off, climb, speed):
    angle = np.arccos(np.cos(climb) * np.cos(off))
    assume(abs(angle - MAX_CROSSING_ANGLE) > 1e-6)
    course = heading + off
    velocity = speed * np.array(
        [np.cos(climb) * np.cos(course), np.cos(climb) * np.sin(course), np.sin(climb)]
    )
    forward = passes_forward(steady([0, 0, 5], velocity), [0.2, 0.7], [heading, heading + np.pi])
    back = np.pi - angle < MAX_CROSSING_ANGLE
    assert forward.tolist() == [angle < MAX_CROSSING_ANGLE, back]


def test_standing_in_a_gate_is_not_passing_it():
    assert not passes_forward(steady([0, 0, 5], [0, 0, 0]), [0.5], [0.0]).any()


@pytest.mark.parametrize("duration", [MAX_DURATION + 1.0, 6e6])
def test_a_flight_of_hours_is_where_a_search_lost_its_way(duration):
    """And its samples would fill the memory."""
    with pytest.raises(TrajectoryOptimizationError, match="longer than 600 s"):
        sample_times(line([0, 0, 5], [1, 0, 5], duration), 1000.0)
