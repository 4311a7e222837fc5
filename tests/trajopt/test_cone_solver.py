"""The solver of programs with second-order cones."""

import logging

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.solvers import MathematicalProgram

from airrace.trajopt.cone_solver import solve_cones


@given(
    st.lists(st.floats(-10.0, 10.0), min_size=2, max_size=6).filter(
        lambda slope: np.linalg.norm(slope) > 0.1
    )
)
def test_the_lowest_point_of_a_ball(slope):
    slope = np.array(slope) / np.linalg.norm(slope)
    program = MathematicalProgram()
    x = program.NewContinuousVariables(len(slope))
    program.AddLinearCost(slope, x)
    A = np.vstack([np.zeros(len(slope)), np.eye(len(slope))])
    program.AddLorentzConeConstraint(A, np.eye(len(A))[0], x)
    for tolerances in ({}, {"tol_gap_abs": 1e-5, "tol_gap_rel": 1e-5, "tol_feas": 1e-6}):
        result = solve_cones(program, **tolerances)
        assert result.is_success()
        np.testing.assert_allclose(result.get_optimal_cost(), -1.0, atol=1e-4)
        np.testing.assert_allclose(result.GetSolution(x), -slope, atol=1e-2)


def test_what_cannot_be_solved_is_no_success():
    program = MathematicalProgram()
    x = program.NewContinuousVariables(1)
    program.AddBoundingBoxConstraint(1.0, 2.0, x)
    program.AddLorentzConeConstraint([[0.0], [1.0]], [0.5, 0.0], x)
    assert not solve_cones(program).is_success()


def test_an_option_that_is_none_is_refused():
    with pytest.raises(RuntimeError, match="tol_bogus"):
        solve_cones(MathematicalProgram(), tol_bogus=1.0)


def test_how_a_program_ended_is_told_by_its_result_alone(caplog):
    """Drake tells what went wrong, too, amid a progress bar; what else it tells is left."""
    program = MathematicalProgram()
    x = program.NewContinuousVariables(1)
    program.AddBoundingBoxConstraint(1.0, 2.0, x)
    program.AddBoundingBoxConstraint(3.0, 4.0, x)
    program.AddLinearCost(x[0])
    with caplog.at_level("INFO", "drake"):
        assert not solve_cones(program).is_success()
        for words in ("Clarabel returns InsufficientProgress", "Meshcat listens"):
            logging.getLogger("drake").info(words)
    assert [record.getMessage() for record in caplog.records] == ["Meshcat listens"]
