"""Peaks and samples are those of the trajectory itself, gradients those of differences."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.min_snap.limits import (
    LimitSamples,
    peak_speed_and_acceleration,
    slowdown_factor,
)
from airrace.trajopt.min_snap.min_snap import DerivativeConstraint, MinSnapProblem, solve_min_snap

LIMITS = 20.0, 10.0


@st.composite
def problems(draw):
    """Waypoints, durations and options of solve_min_snap(): legs and laps."""
    random = np.random.Generator(np.random.PCG64(draw(st.integers(0, 10**6))))
    count, dimensions = draw(st.integers(2, 11)), draw(st.integers(1, 4))
    options = dict(periodic=count > 3 and draw(st.booleans()))
    waypoints = random.normal(scale=20.0, size=(count, dimensions))
    if options["periodic"]:
        options["period_offset"] = random.normal(size=dimensions)
        if draw(st.booleans()):  # in some dimensions only
            velocity = np.where(random.random(dimensions) < 0.5, np.nan, 3.0)
            options["constraints"] = [DerivativeConstraint(1, 1, velocity)]
    else:
        options["constraints"] = [
            DerivativeConstraint(i, order, size * random.normal(size=dimensions))
            for i, size in ((0, 3.0), (-1, 0.0))
            for order in (1, 2, 3)
        ]
    durations = random.uniform(0.5, 3.0, count if options["periodic"] else count - 1)
    return waypoints, durations, options


@given(problems())
def test_excess_is_that_of_the_trajectory(problem):
    waypoints, durations, options = problem
    speed, acceleration = peak_speed_and_acceleration(
        solve_min_snap(waypoints, durations, **options)
    )
    problem = MinSnapProblem(waypoints, **options)
    assert slowdown_factor(problem, durations, LIMITS) == pytest.approx(
        max(speed / LIMITS[0], np.sqrt(acceleration / LIMITS[1])), rel=1e-8
    )


def test_where_there_are_many_minima_there_is_no_answer():
    waypoints = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    at_rest = [DerivativeConstraint(i, order, np.zeros(3)) for i in (0, -1) for order in (1, 2)]
    MinSnapProblem(waypoints, constraints=at_rest).require_unique()
    with pytest.raises(TrajectoryOptimizationError, match="not unique"):
        MinSnapProblem(waypoints).require_unique()


@pytest.mark.parametrize(
    "durations, error, words",
    [
        ([1.0, 1.0], ValueError, "durations must be 1"),
        ([0.0], ValueError, "positive and finite"),
        ([1e-300], TrajectoryOptimizationError, "even out"),
    ],
)
def test_durations_that_cannot_be(durations, error, words):
    problem = MinSnapProblem(
        [[0.0], [5.0]], constraints=[DerivativeConstraint(i, 1, [0.0]) for i in (0, -1)]
    )
    with pytest.raises(error, match=f"(?i){words}"):
        slowdown_factor(problem, durations, LIMITS)


@pytest.mark.parametrize("constrained", [False, True])
@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("degree, order", [(9, 4), (7, 3)])
def test_limit_samples_and_their_gradient(constrained, periodic, degree, order):
    rng = np.random.default_rng(0)
    waypoints = rng.normal(scale=20.0, size=(6, 3))
    options = dict(degree=degree, minimized_derivative=order, periodic=periodic)
    if periodic:
        options["period_offset"] = [100.0, 20.0, 3.0]
    if constrained:
        options["constraints"] = [
            DerivativeConstraint(1, 2, [0.0, 3.0, np.nan]),
            DerivativeConstraint(2, 1, [np.nan, 5.0, 1.0]),
        ]
    durations = rng.uniform(1, 4, len(waypoints) - (not periodic))
    samples = LimitSamples(MinSnapProblem(waypoints, **options), (20.0, 10.0), 5)
    values, jacobian = samples(durations)
    p = solve_min_snap(waypoints, durations, **options)
    times = np.array(p.get_segment_times())[:-1, None] + durations[:, None] * np.linspace(0, 1, 5)
    expected = [
        np.sum(p.derivative(k).vector_values(times.ravel()) ** 2, axis=0) / limit**2
        for k, limit in ((1, 20.0), (2, 10.0))
    ]
    np.testing.assert_allclose(values, np.concatenate(expected), rtol=1e-7, atol=1e-9)
    h = 1e-4
    numeric = np.column_stack(
        [
            (samples(durations + h * e)[0] - samples(durations - h * e)[0]) / (2 * h)
            for e in np.eye(len(durations))
        ]
    )
    np.testing.assert_allclose(jacobian, numeric, rtol=1e-5, atol=1e-6 * np.abs(jacobian).max())
