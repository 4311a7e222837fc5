"""The program of minimum snap: equal to the closed form, and open to constraints of the user's."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.solvers import ClarabelSolver, OsqpSolver

from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.flight_limits import FlightConstraints
from airrace.trajopt.min_snap.circuit import circuit_problem
from airrace.trajopt.min_snap.min_snap import DerivativeConstraint, MinSnapProblem, solve_min_snap
from airrace.trajopt.min_snap.transition import plan_transition_from_hover, transition_problem
from tests.trajopt.min_snap.test_circuit import HEADINGS, LIMITS, MIDPOINTS, pylons_of, reference
from tests.trajopt.min_snap.test_min_snap import few, make_problem, random_constraints, seeds
from tests.worlds.cases import first

REST = [DerivativeConstraint(i, k, np.zeros(3)) for i in (0, -1) for k in (1, 2, 3, 4)]


def samples(trajectory, count=200):
    """Of a trajectory, (d, count)."""
    return trajectory.vector_values(np.linspace(0.0, trajectory.end_time(), count))


@given(seeds, st.booleans())
@few
def test_it_is_the_closed_form(seed, constrained):
    """To 1e-9 of what it spans, and every waypoint to the last digit."""
    waypoints, durations, options = make_problem(seed)
    if constrained:
        rng = np.random.default_rng(seed)
        options["constraints"] = random_constraints(rng, len(waypoints), 4, orders=(1, 2))
    problem = MinSnapProblem(waypoints, **options)
    fast = problem.trajectory(durations, problem.solve_closed_form(durations))
    found = problem.program(durations).solve()
    span = np.abs(samples(fast)).max()
    np.testing.assert_allclose(samples(found), samples(fast), atol=1e-9 * max(span, 1.0))


@given(seeds, st.floats(0.0, 1.0), st.integers(0, 4))
@few
def test_points_are_linear_in_the_variables(seed, share, order):
    waypoints, durations, options = make_problem(seed)
    problem = MinSnapProblem(waypoints, **options)
    program = problem.program(durations)
    derivatives = problem.solve_closed_form(durations)
    x = derivatives.reshape(program.x.shape) / program.unit
    time = share * durations.sum()
    A, b = program.at(time, order)
    expected = problem.trajectory(durations, derivatives).EvalDerivative(time, order).ravel()
    atol = 1e-7 * (1.0 + np.abs(expected).max())
    np.testing.assert_allclose(A @ x.ravel() + b, expected, atol=atol)


def test_a_wall():
    """A lap through the gates of the track stays in front of a wall that it would fly through."""
    problem = circuit_problem(MIDPOINTS, HEADINGS, 3)
    durations = np.full(len(MIDPOINTS), 3.0)
    free, wall = problem.program(durations).solve(), MIDPOINTS[:, 1].max() + 0.5  # y, in m
    assert samples(free)[1].max() > wall + 0.5
    program = problem.program(durations)
    times = np.linspace(0.0, durations.sum(), 150)
    for time in times:
        A, b = program.at(time)
        program.prog.AddLinearConstraint(A[1:2], [-np.inf], wall - b[1:2], program.x.ravel())
    kept = program.solve()
    assert kept.vector_values(times)[1].max() < wall + 1e-6
    breaks = np.concatenate([[0.0], np.cumsum(durations)])[:-1]
    np.testing.assert_array_equal(kept.vector_values(breaks)[:3].T, MIDPOINTS)


def test_a_solver_may_be_chosen():
    waypoints, durations, options = make_problem(3)
    usual = samples(solve_min_snap(waypoints, durations, **options))
    for solver, tolerance in ((ClarabelSolver(), 1e-6), (OsqpSolver(), 1e-2)):
        other = samples(solve_min_snap(waypoints, durations, solver=solver, **options))
        np.testing.assert_allclose(other, usual, atol=tolerance)


def test_it_has_names():
    """Of costs and constraints, as the program is printed."""
    program = circuit_problem(MIDPOINTS, HEADINGS, 3).program(np.full(10, 3.0))
    costs = [each.evaluator().get_description() for each in program.prog.GetAllCosts()]
    assert costs == [f"smoothness of {name}" for name in ("x", "y", "z", "yaw")]
    names = [each.evaluator().get_description() for each in program.prog.GetAllConstraints()]
    assert len(names) == 4 * len(MIDPOINTS) and "z at waypoint 3" in names
    text = str(program.prog)
    assert "smoothness of x" in text and "yaw at waypoint 9" in text


def test_no_trajectory():
    waypoints, durations, options = make_problem(5)
    program = MinSnapProblem(waypoints, **options).program(durations)
    program.prog.AddLinearConstraint(program.x[0, 0, 0] >= 1.0)
    with pytest.raises(TrajectoryOptimizationError, match="finds no trajectory: "):
        program.solve()
    with pytest.raises(ValueError, match="The time must lie in 0 ... "):
        program.at(-1.0)


@pytest.mark.parametrize("count", range(3, 40))
def test_the_end_is_inside(count):
    """However the durations are added up."""
    durations = np.random.default_rng(count).uniform(0.1, 3.0, count)
    waypoints = np.arange(count, dtype=float)[:, None] ** 2
    program = MinSnapProblem(waypoints, periodic=True).program(durations)
    A, b = program.at(durations.sum())
    assert A.shape == (1, program.x.size) and b.shape == (1,)


@pytest.mark.parametrize("order", [-1, 2.5])
def test_orders_that_there_are_not(order):
    waypoints, durations, options = make_problem(5)
    with pytest.raises(ValueError, match="order of a derivative must be"):
        MinSnapProblem(waypoints, **options).program(durations).at(0.1, order)


@pytest.mark.parametrize("ratio", [1e3, 1e4])
@pytest.mark.parametrize("pattern", [(0, 1, 0, 1, 0), (0, 0, -1, 0, 0), (0, 0, 1, 0, 0)])
def test_unlike_durations_lose_no_waypoint(ratio, pattern):
    """Neither in the program nor in the closed form."""
    waypoints = np.random.default_rng(0).uniform(-10.0, 10.0, (6, 3))
    durations = ratio ** np.array(pattern, float)
    problem = MinSnapProblem(waypoints, constraints=REST)
    breaks = np.concatenate([[0.0], np.cumsum(durations)])
    fast = problem.trajectory(durations, problem.solve_closed_form(durations))
    for path in (fast, problem.program(durations).solve()):
        np.testing.assert_allclose(path.vector_values(breaks).T, waypoints, atol=1e-6)


@pytest.mark.parametrize("dimensions", first([6, 3, 4]))
def test_laps_and_entries_are_solutions_of_their_programs(dimensions):
    circuit = reference(dimensions)
    problem = circuit_problem(MIDPOINTS, HEADINGS, dimensions, approach=circuit.approach)
    again = problem.program(np.diff(circuit.breaks)).solve()
    np.testing.assert_allclose(samples(again), samples(circuit.polynomial), atol=1e-9)
    constraints = FlightConstraints(pylons_of(MIDPOINTS, HEADINGS), **LIMITS)
    start = np.zeros((5, 4))
    start[0] = [*MIDPOINTS[0] - 20.0 * np.array([np.cos(HEADINGS[0]), np.sin(HEADINGS[0]), 0]), 0]
    start[0, 3] = HEADINGS[0]
    entry, phase = plan_transition_from_hover(start, circuit, dimensions, constraints)
    problem = transition_problem(start, circuit, dimensions, phase)
    again = problem.program(np.diff(entry.breaks)).solve()
    np.testing.assert_allclose(samples(again), samples(entry.polynomial), atol=1e-9)
