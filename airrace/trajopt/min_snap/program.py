"""Minimum snap as a program of Drake, to which constraints and costs can be added."""

from typing import TYPE_CHECKING

import numpy as np
from pydrake.solvers import (
    ChooseBestSolver,
    MakeSolver,
    MathematicalProgram,
    SolverInterface,
    SolverOptions,
)
from pydrake.trajectories import PiecewisePolynomial

from airrace.trajopt.errors import TrajectoryOptimizationError

if TYPE_CHECKING:
    from airrace.trajopt.min_snap.min_snap import MinSnapProblem

_DIMENSIONS = ("x", "y", "z", "yaw")
_EQUALITY_QP = "EqConstrainedQP"  # as Drake calls its solver
_TOLERANCE = 1e-8  # of the equations, whose variables have unit curvature


class MinSnapProgram:
    """A quadratic program: the variables are the derivatives of a trajectory at its waypoints.

    A piecewise polynomial follows from them, and is continuous whatever they are. The cost is the
    integral of the squared norm of the snap (or what else is minimised), one a dimension; the
    constraints fix each waypoint, and what DerivativeConstraints say. All have names.

        program = MinSnapProblem(waypoints, periodic=True).program(durations)
        A, b = program.at(0.5 * durations[0])                  # (d, variables), (d,)
        program.prog.AddLinearConstraint(A[2:3], [-np.inf], 3.0 - b[2:3], program.x.ravel())
        trajectory = program.solve()                           # below a ceiling of 3 m
    """

    def __init__(self, problem: "MinSnapProblem", durations: np.ndarray):
        """Builds the program. Args: problem: what is wanted. durations: of the segments (s)."""
        self._problem, self._durations = problem, durations
        self._breaks = np.concatenate([[0.0], np.cumsum(durations)])
        _, hessian, gradient = problem.assemble(durations)
        #: The program: add to it, and look at it.
        self.prog = MathematicalProgram()
        n = len(problem.order) // 2
        #: Its variables, (waypoints, n, d): derivative k of dimension j at waypoint i is
        #: ``unit[i, k, 0] * x[i, k, j]``.
        self.x = self.prog.NewContinuousVariables(problem.values.size, "x").reshape(
            -1, n, problem.values.shape[1]
        )
        # Derivatives of unlike orders have unlike units: this gives all of them unit curvature.
        unit = 1.0 / np.sqrt(np.diag(hessian))
        self.unit = unit.reshape(-1, n, 1)
        scaled = unit[:, None] * hessian * unit
        # What is fixed stands in the cost as a number. With it as a variable, the cost would not
        # change with where the whole path lies, and solvers would lose digits.
        gradient = unit[:, None] * (gradient + hessian @ problem.values)
        for j, variables in enumerate(self.x.reshape(-1, self.x.shape[2]).T):
            name = _DIMENSIONS[j] if self.x.shape[2] <= len(_DIMENSIONS) else str(j)
            free = ~problem.fixed[:, j]
            cost = self.prog.AddQuadraticCost(
                scaled * np.outer(free, free), gradient[:, j] * free, variables, is_convex=True
            )
            cost.evaluator().set_description(f"smoothness of {name}")
            for row in np.flatnonzero(problem.fixed[:, j]):
                i, k = divmod(row, n)
                fixed = self.prog.AddLinearEqualityConstraint(
                    np.eye(1), problem.values[row, j : j + 1] / unit[row], variables[row : row + 1]
                )
                what = f"derivative {k} of {name}" if k else name
                fixed.evaluator().set_description(f"{what} at waypoint {i}")

    def at(self, time: float, order: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Returns the trajectory, or a derivative of it, as a linear function of the variables.

        Args:
            time: from 0 to the sum of the durations (s).
            order: of the derivative.

        Returns:
            A, (d, variables), and b, (d,): it is ``A @ x.ravel() + b``.

        Raises:
            ValueError: if the time is outside, or there is no such order.
        """
        if order < 0 or order != int(order):
            raise ValueError(f"The order of a derivative must be 0, 1, 2, ..., not {order}.")
        end = self._breaks[-1]
        if end < time < (1.0 + 1e-9) * end:
            time = end  # durations were added up in another order
        if not 0.0 <= time <= end:
            raise ValueError(f"The time must lie in 0 ... {self._breaks[-1]:g} s, not {time:g}.")
        problem, T = self._problem, self._durations
        leg = min(int(np.searchsorted(self._breaks, time, side="right")) - 1, len(T) - 1)
        share, degrees = (time - self._breaks[leg]) / T[leg], np.arange(len(problem.order))
        factors = np.ones(len(degrees))  # d^order/dt^order of (t / T)^degree
        for k in range(order):
            factors *= (degrees - k) / T[leg]
        powers = np.where(degrees >= order, share ** np.maximum(degrees - order, 0), 0.0)
        row = (factors * powers) @ problem.basis * T[leg] ** problem.order
        d = self.x.shape[2]
        A = np.zeros((d, *self.x.shape))
        flat = A.reshape(d, -1, d)
        for j in range(d):
            np.add.at(flat[j, :, j], problem.rows[leg], row * self.unit.ravel()[problem.rows[leg]])
        b = np.zeros(d) if order else problem.origin.astype(float)
        if leg == len(T) - 1:
            b = b + row[len(problem.order) // 2] * problem.offset
        return A.reshape(d, -1), b

    def solve(self, solver: SolverInterface | None = None) -> PiecewisePolynomial:
        """Returns the best trajectory.

        Args:
            solver: of Drake; by default the one that Drake chooses, which is its
                EqualityConstrainedQPSolver unless something was added that this can't take.

        Raises:
            TrajectoryOptimizationError: if the solver finds none.
        """
        solver = solver or MakeSolver(ChooseBestSolver(self.prog))
        options = SolverOptions()
        if solver.solver_id().name() == _EQUALITY_QP:
            size = np.abs(self._problem.values / self.unit.reshape(-1, 1)).max()
            options.SetOption(solver.solver_id(), "FeasibilityTol", _TOLERANCE * (1.0 + size))
        result = solver.Solve(self.prog, None, options)
        if not result.is_success():
            raise TrajectoryOptimizationError(
                f"{result.get_solver_id().name()} finds no trajectory: "
                f"{result.get_solution_result().name}."
            )
        found = self.unit * result.GetSolution(self.x.ravel()).reshape(self.x.shape)
        derivatives = found.reshape(self._problem.values.shape)
        # What is fixed is so to the last digit.
        derivatives = np.where(self._problem.fixed, self._problem.values, derivatives)
        return self._problem.trajectory(self._durations, derivatives)
