"""Linear constraints of a MathematicalProgram.

Its own AddLinearConstraint() also takes sparse matrices and looks for scipy each time:
where there is none, on the whole of Python's path.
"""

import numpy as np
from pydrake.solvers import LinearConstraint, LinearEqualityConstraint


def add_rows(program, A, lower, upper, variables):
    """Adds lower <= A x <= upper; returns the Binding.

    Args:
        program: a MathematicalProgram.
        A: (m, n). lower, upper: (m,). variables: n of them.
    """
    constraint = LinearConstraint(A, np.asarray(lower, float), np.asarray(upper, float))
    return program.AddConstraint(constraint, np.asarray(variables))


def add_equal_rows(program, A, values, variables):
    """Adds A x = values, (m,); returns the Binding. Args: see add_rows()."""
    return program.AddConstraint(
        LinearEqualityConstraint(A, np.asarray(values, float)), np.asarray(variables)
    )
