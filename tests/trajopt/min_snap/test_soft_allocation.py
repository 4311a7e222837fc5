"""Time allocation with soft limits: its guess, its cost, and what it leaves of the limits."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.track import load_track
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.min_snap.limits import peak_speed_and_acceleration
from airrace.trajopt.min_snap.min_snap import DerivativeConstraint, MinSnapProblem, solve_min_snap
from airrace.trajopt.min_snap.soft_allocation import _cost, allocate_times_softly, guess_durations
from airrace.trajopt.min_snap.time_allocation import allocate_times

LIMITS = dict(max_speed=20.0, max_acceleration=10.0)
REST = [DerivativeConstraint(i, k, np.zeros(3)) for i in (0, -1) for k in range(1, 5)]


@pytest.fixture(scope="module")
def lap():
    """The midpoints of the track student-airrace from gate 1 to gate 1, (11, 3) m."""
    midpoints = np.array([gate.p_WG for gate in load_track("student-airrace").gates])
    return np.vstack([midpoints, midpoints[:1]])


def test_the_guess():
    guess = guess_durations(np.array([20.0, 1000.0]), 20.0, 10.0)
    np.testing.assert_allclose(guess, [2.0 * (1.0 + 13.0 * np.exp(-2.0)), 100.0], rtol=1e-12)


@given(st.floats(0.1, 100.0), st.floats(0.5, 30.0), st.floats(0.5, 30.0))
def test_the_guess_grows_as_limits_fall(chord, speed, acceleration):
    (t,) = guess_durations(np.array([chord]), speed, acceleration)
    assert guess_durations(np.array([chord]), speed, acceleration / 2)[0] >= t >= 2 * chord / speed


def test_the_cost_of_a_flight_from_rest_to_rest():
    """In closed form: with all derivatives zero at both ends, the polynomial is known."""
    problem, T = MinSnapProblem([[0, 0, 0], [3, 4, 12]], constraints=REST), 12.0
    path = problem.trajectory(np.array([T]), problem.solve_closed_form(np.array([T])))
    speed, acceleration = peak_speed_and_acceleration(path)
    times = np.linspace(0.0, T, 20001)
    snap = np.square(path.derivative(4).vector_values(times)).sum(axis=0)
    expected = np.trapezoid(snap, times) + 500.0 * T**2
    expected += np.exp(100.0 * (speed / 3.0 - 1.0)) + np.exp(100.0 * (acceleration / 2.0 - 1.0))
    assert _cost(problem, np.array([T]), np.array([3.0, 2.0])) == pytest.approx(expected, rel=1e-6)
    # However far a limit is exceeded, what it costs is bounded.
    worst = _cost(problem, np.array([0.1]), np.array([3.0, 2.0]))
    snap = problem.assemble(np.array([0.1]))[0]
    ends = problem.ends(problem.solve_closed_form(np.array([0.1])))
    assert worst == pytest.approx(np.sum(ends * (snap @ ends)) + 5.0 + 2e12, rel=1e-9)
    assert np.isfinite(_cost(problem, np.array([1e-3]), np.array([3.0, 2.0])))


def test_it_costs_less_than_the_guess_and_is_the_same_each_time(lap):
    durations = allocate_times_softly(lap, constraints=REST, **LIMITS)
    np.testing.assert_array_equal(durations, allocate_times_softly(lap, constraints=REST, **LIMITS))
    problem, limits = MinSnapProblem(lap, constraints=REST), np.array([20.0, 10.0])
    guess = guess_durations(np.linalg.norm(np.diff(lap, axis=0), axis=1), *limits)
    assert _cost(problem, durations, limits) < 0.8 * _cost(problem, guess, limits)


@pytest.mark.parametrize("share", [1.0, 0.9])
def test_stretched_it_keeps_the_limits(lap, share):
    soft = allocate_times_softly(lap, constraints=REST, **LIMITS)
    kept = allocate_times_softly(lap, constraints=REST, share=share, **LIMITS)
    assert np.ptp(kept / soft) < 1e-9 and kept[0] >= soft[0]
    speed, acceleration = peak_speed_and_acceleration(solve_min_snap(lap, kept, constraints=REST))
    assert speed <= 20.0 * share * (1 + 1e-7) and acceleration <= 10.0 * share * (1 + 1e-7)


def test_the_quickest_durations_are_shorter(lap):
    soft = allocate_times_softly(lap, constraints=REST, share=1.0, **LIMITS)
    assert allocate_times(lap, constraints=REST, **LIMITS).sum() < soft.sum()


@pytest.mark.parametrize("limits", [(0.0, 1.0), (1.0, -1.0), (np.inf, 1.0), (1.0, np.nan)])
def test_limits_must_be_positive(lap, limits):
    with pytest.raises(ValueError, match="must be positive"):
        allocate_times_softly(lap, max_speed=limits[0], max_acceleration=limits[1])


def test_a_problem_of_many_solutions_is_refused():
    with pytest.raises(TrajectoryOptimizationError, match="not unique"):
        allocate_times_softly([[0, 0, 0], [1, 0, 0]], **LIMITS)
