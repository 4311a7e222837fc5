"""The quick answer is that of the trajectory itself."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.trajopt.min_snap.limit_excess import LimitExcess
from airrace.trajopt.min_snap.min_snap import (
    DerivativeConstraint,
    TrajectoryOptimizationError,
    solve_min_snap,
)
from airrace.trajopt.min_snap.problem import MinSnapProblem
from airrace.trajopt.min_snap.time_allocation import peak_speed_and_acceleration

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
    excess = LimitExcess(MinSnapProblem.build(waypoints, **options))
    assert excess(durations, LIMITS) == pytest.approx(
        max(speed / LIMITS[0], np.sqrt(acceleration / LIMITS[1])), rel=1e-8
    )


def test_where_there_are_many_minima_there_is_no_answer():
    waypoints = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    at_rest = [DerivativeConstraint(i, order, np.zeros(3)) for i in (0, -1) for order in (1, 2)]
    LimitExcess(MinSnapProblem.build(waypoints, constraints=at_rest))([1.0], LIMITS)
    with pytest.raises(TrajectoryOptimizationError, match="not unique; add"):
        LimitExcess(MinSnapProblem.build(waypoints))


@pytest.mark.parametrize(
    "durations, error, words",
    [
        ([1.0, 1.0], ValueError, "durations must be 1"),
        ([0.0], ValueError, "positive and finite"),
        ([1e-300], TrajectoryOptimizationError, "even out"),
    ],
)
def test_durations_that_cannot_be(durations, error, words):
    problem = MinSnapProblem.build(
        [[0.0], [5.0]], constraints=[DerivativeConstraint(i, 1, [0.0]) for i in (0, -1)]
    )
    with pytest.raises(error, match=f"(?i){words}"):
        LimitExcess(problem)(durations, LIMITS)
