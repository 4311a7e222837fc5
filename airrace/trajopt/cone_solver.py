"""The solver of convex programs with second-order cones: Clarabel."""

import logging

from pydrake.solvers import (
    ClarabelSolver,
    MathematicalProgram,
    MathematicalProgramResult,
    SolverOptions,
)


def _is_news(record: logging.LogRecord) -> bool:
    """Whether a message says more than how a program ended, which the result says, too."""
    return not record.getMessage().startswith("Clarabel returns")


logging.getLogger("drake").addFilter(_is_news)


def solve_cones(program: MathematicalProgram, **tolerances: float) -> MathematicalProgramResult:
    """Returns what Clarabel makes of a program.

    Args: tolerances: tol_gap_abs, tol_gap_rel, tol_feas, if not Clarabel's own 1e-8.
    """
    options = SolverOptions()
    # It takes two fifths more time, and changes solutions by less than the tolerances.
    options.SetOption(ClarabelSolver.id(), "iterative_refinement_enable", 0)
    for name, value in tolerances.items():
        options.SetOption(ClarabelSolver.id(), name, value)
    return ClarabelSolver().Solve(program, None, options)
