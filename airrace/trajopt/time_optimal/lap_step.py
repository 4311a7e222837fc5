"""The convex program of one iteration: its variables, and constraints on samples of the lap."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from pydrake.solvers import MathematicalProgram

from airrace.trajopt.cone_solver import solve_cones
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.time_optimal.dynamics import LinearDynamics
from airrace.trajopt.time_optimal.lap_samples import Grid, LapSamples
from airrace.trajopt.time_optimal.lap_spline import ORDERS, LapSpline
from airrace.trajopt.time_optimal.thrust_axis_angle import turn_gradients

_TOLERANCES = {"tol_gap_abs": 1e-4, "tol_gap_rel": 1e-4, "tol_feas": 1e-6}
_MOST_STRETCH = 0.4  # of a leg's duration, in one step


class LapStep:
    """Collects constraints on samples of the lap after a step, and solves for it.

    With time normalised to a leg, z the leg's coefficients and T its duration,
    samples are linear in z. For the derivatives d at a gate z = T^k d, which is
    linearised; so is s = T^2. The rest of T's influence is exact: the limits
    |w| <= T v_max on the normalised velocity w and |u + s g| <= s f_max on the
    normalised acceleration u are second-order cones.

    The axes to which the thrust-axis angle refers turn when the path changes, at a sample by
    what all that lies before it adds; that is linearised, too.

    Attributes:
        lap, samples, grid: to start from, and where it is sampled.
        dynamics: of the samples.
        program: the MathematicalProgram, to be added to.
        excess: two slack()s, by which shares the limit of speed and all other limits of the
            dynamics may be exceeded; empty, unless it is set before they are added.
    """

    def __init__(self, samples: LapSamples, grid: Grid):
        """Constructs the program of a step.

        Args: samples: of the lap to start from. grid: of the samples.

        Raises:
            TrajectoryOptimizationError: if the thrust turns over at a point, as on a straight way
                down, and so has no direction there.
        """
        self.lap, self.samples, self.grid = samples.lap, samples, grid
        self.dynamics = LinearDynamics.linearize(samples)
        self.program = MathematicalProgram()
        self.excess: Sequence[np.ndarray] = ()
        T, after = self.lap.durations, self.lap.after
        n, m = self.lap.interior.shape[:2]
        gates = len(self.lap.gates)
        new = self.program.NewContinuousVariables
        # Of order one: derivatives in units of a duration, durations relative.
        self._gates = new(gates * ORDERS * 4).reshape(gates, ORDERS, 4)
        self._interior = new(n * m * 4).reshape(n, m, 4) if m else np.zeros((n, 0, 4), object)
        self._stretch = new(n)
        self._turns = new(n + 1)  # of the transported axes, up to each gate
        legs = zip(self._gates, self._interior, self._gates[after], self._turns, self._stretch)
        self._variables = [np.concatenate([np.ravel(part) for part in leg]) for leg in legs]
        if self.lap.is_closed:
            # The angle has another value where the lap ends.
            last_angle = new(1)[0]
            self._variables[-1][4 * (ORDERS + m) + 3] = last_angle
            self._units = np.sqrt(T * np.roll(T, 1))
        else:
            last_angle = self._gates[-1, 0, 3]
            for gate, kept in zip(self._gates[[0, -1]], self.lap.kept):
                self._fix(gate[:, :3][kept[:, :3]], gate[kept[:, 3], 3])
            self._units = np.array([T[0], *np.sqrt(T[1:] * T[:-1]), T[-1]])
        if self.lap.has_turn:
            angles = np.array([last_angle, self._gates[0, 0, 3], self._turns[-1]])
            row = np.array([[1.0, -1.0, -1.0]])
            self.program.AddLinearEqualityConstraint(row, [0.0], angles)
        self._fix(self._turns[:1])
        orders = np.arange(ORDERS)
        before, end = ((T / u)[:, None] ** orders for u in (self._units[:n], self._units[after]))
        self._scale = np.concatenate([before, np.ones((n, m)), end], axis=1)
        exponents = np.array([*orders, *np.zeros(m), *orders])
        self._by_stretch = exponents[:, None] * self.lap.coefficients()
        self.program.AddLinearCost(T, self._stretch)
        self.program.AddBoundingBoxConstraint(-_MOST_STRETCH, _MOST_STRETCH, self._stretch)
        self._follow_axes()

    def _follow_axes(self):
        """Sets how the axes turn about the thrust, sample by sample."""
        grid, lap = self.grid, self.lap
        force, d_force, force_by_T = self.dynamics.force
        between = lap.evaluate(grid.matrices_between)
        gradients, by_T, sums = turn_gradients(
            between, lap.durations, grid.fractions, lap.chart, self.samples.limits.air
        )
        nodes, every = np.arange(between.shape[2]), np.arange(grid.samples)
        amount = np.linalg.norm(force, axis=0)
        chart = lap.chart
        b, d_force = chart @ (force / amount), np.tensordot(chart, d_force, 1)
        force_by_T = chart @ force_by_T
        k = 1.0 / (amount * (1.0 + b[2]))
        # The least rotation that takes the vertical to b turns about b as b moves.
        d_own = (b[1] * k)[:, None, None] * d_force[0] - (b[0] * k)[:, None, None] * d_force[1]
        own_by_T = k * (b[1] * force_by_T[0] - b[0] * force_by_T[1])
        if not all(np.isfinite(each).all() for each in (gradients, by_T, d_own, own_by_T)):
            raise TrajectoryOptimizationError(
                "The thrust of the flight to start from turns over at a point, as on a straight "
                "way up or down. Move a gate to the side, or name a min_lift above 0."
            )
        self._axis_turns = []
        for leg in range(len(lap.durations)):
            here = self.of(leg)
            turns = sums @ self.rows(leg, nodes, gradients[leg], by_T[leg], grid.matrices_between)
            turns[:, -2] = 1.0  # and what was before
            own = self.rows(leg, every, d_own[here], own_by_T[here], grid.matrices)
            self._axis_turns.append(own - turns[:-1])
            row = np.append(turns[-1], -1.0)[None]
            variables = np.append(self._variables[leg], self._turns[leg + 1])
            self.program.AddLinearEqualityConstraint(row, [0.0], variables)

    def of(self, leg: int) -> slice:
        """Returns where the samples of a leg are among all."""
        return slice(leg * self.grid.samples, (leg + 1) * self.grid.samples)

    def size(self, leg: int) -> int:
        """Returns the number of a leg's variables; the last is its relative stretch."""
        return len(self._variables[leg])

    def only_angle(self) -> None:
        """Leaves path and durations as they are."""
        self._fix(self._gates[:, :, :3], self._interior[:, :, :3], self._stretch)

    def slack(self, cost: float) -> np.ndarray:
        """Returns a new variable of zero or more that costs so many s by one, (1,)."""
        slack = self.program.NewContinuousVariables(1)
        self.program.AddBoundingBoxConstraint(0.0, np.inf, slack)
        self.program.AddLinearCost([cost], slack)
        return slack

    def excess_found(self) -> float:
        """Returns by which share the solution exceeds limits."""
        return max([0.0, *(self.result.GetSolution(each)[0] for each in self.excess)])

    def _fix(self, *variables):
        for fixed in variables:
            if fixed.size:
                zero = np.zeros(fixed.size)
                self.program.AddBoundingBoxConstraint(zero, zero, fixed.ravel())

    def derivatives(self, leg: int, order: int) -> tuple[np.ndarray, np.ndarray]:
        """Returns how samples' derivatives in normalised time depend on the step of a leg.

        That is by coefficients, (samples, coefficients), the same for each dimension, and by
        the relative stretch, (samples, 4).
        """
        matrix = self.grid.matrices[order]
        return matrix * self._scale[leg], matrix @ self._by_stretch[leg]

    def rows(
        self,
        leg: int,
        which: np.ndarray,
        gradients: np.ndarray,
        by_T: ArrayLike,
        matrices: np.ndarray | None = None,
    ) -> np.ndarray:
        """Returns rows over the variables of a leg, (rows, variables).

        Args:
            leg: from 0.
            which: sample of each row, (rows,).
            gradients: of the rows, by derivatives in normalised time, (rows, orders, 4).
            by_T: of the rows, by the leg's duration, (rows,) or a number.
            matrices: of lap_spline.basis(), if not those of the grid; then the
                angle's value must not matter.
        """
        orders = gradients.shape[1]
        basis = (self.grid.matrices if matrices is None else matrices)[:orders, which]
        result = np.zeros((len(which), self.size(leg)))
        by_z = basis.transpose(1, 2, 0) @ gradients  # (rows, coefficients, 4)
        result[:, :-2] = (by_z * self._scale[leg][:, None]).reshape(len(which), 4 * basis.shape[2])
        result[:, -1] = np.einsum("rcd,cd->r", by_z, self._by_stretch[leg])
        result[:, -1] += by_T * self.lap.durations[leg]
        if matrices is None:
            result += gradients[:, 0, 3:] * self._axis_turns[leg][which]
        return result

    def at_most(
        self,
        leg: int,
        rows: np.ndarray,
        bounds: np.ndarray,
        slack_cost: float | None = None,
        extra: np.ndarray | tuple = (),
        limit: float | np.ndarray | None = None,
    ) -> None:
        """Constrains rows over a leg's variables to lie below bounds.

        Args:
            leg: from 0.
            rows: (rows, variables). bounds: (rows,).
            slack_cost: of exceeding the worst bound by one (s); None never allows it.
            extra: variables of further columns.
            limit: of the dynamics but speed, all of it, if it may be exceeded, a number or (rows,).
        """
        if not len(rows):
            return
        variables = np.concatenate([self._variables[leg], extra])
        if limit is not None and len(self.excess):
            variables = np.append(variables, self.excess[1])
            rows = np.hstack([rows, np.full((len(rows), 1), -1.0) * np.reshape(limit, (-1, 1))])
        if slack_cost is not None:
            variables = np.append(variables, self.slack(slack_cost))
            rows = np.hstack([rows, np.full((len(rows), 1), -1.0)])
        self.program.AddLinearConstraint(rows, np.full(len(rows), -np.inf), bounds, variables)

    def in_cones(
        self,
        leg: int,
        rows: np.ndarray,
        values: np.ndarray,
        extra: np.ndarray | None = None,
        factor: float = 1.0,
    ) -> None:
        """Constrains vectors of rows to Lorentz cones.

        Args:
            leg: from 0.
            rows: (cones, k, variables). values: where there is no step, (cones, k).
            extra: one variable a cone, of which a factor is added to its first row.
        """
        variables = self._variables[leg]
        for j, (A, b) in enumerate(zip(rows, values)):
            if extra is not None:
                A = np.hstack([A, np.zeros((len(A), 1))])
                A[0, -1] = factor
                # An array: a list of variables takes twice as long to be handed over.
                self.program.AddLorentzConeConstraint(A, b, np.append(variables, extra[j]))
            else:
                self.program.AddLorentzConeConstraint(A, b, variables)

    def least_squares(self, leg: int, rows: np.ndarray, values: np.ndarray) -> None:
        """Adds |rows x + values|^2 to the cost, over a leg's variables."""
        self.program.AddQuadraticCost(
            2.0 * rows.T @ rows, 2.0 * rows.T @ values, self._variables[leg], is_convex=True
        )

    def at_gate(self, i: int, order: int) -> tuple[np.ndarray, float]:
        """Returns the variables of a derivative of the path at a gate, (3,), and their unit."""
        return self._gates[i, order, :3], self._units[i] ** -order

    def solve(self) -> LapSpline | None:
        """Returns the lap after the best step, or None if the solver finds none."""
        self.result = result = solve_cones(self.program, **_TOLERANCES)
        x = result.get_x_val()
        if not np.isfinite(x).all():
            return None
        get = result.GetSolution
        lap, n = self.lap, len(self.lap.durations)
        gates = get(self._gates.reshape(len(self._units), -1)).reshape(-1, ORDERS, 4)
        stretch, turns = get(self._stretch), get(self._turns)
        after = gates[lap.after]
        if lap.is_closed:
            after[-1, 0, 3] += turns[-1]
        interior = np.zeros_like(lap.interior)
        if interior.size:
            interior = get(self._interior.reshape(n, -1)).reshape(interior.shape)
        change = np.concatenate([gates[:n], interior, after], axis=1)
        z = lap.coefficients() + self._scale[..., None] * change
        z += self._by_stretch * stretch[:, None, None]
        return lap.stepped(z, lap.durations * (1.0 + stretch), lap.turn + float(turns[-1]))
