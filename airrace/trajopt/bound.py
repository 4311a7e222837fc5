"""The lap time of a point mass: what no vehicle with the same limits can beat."""

import dataclasses as dc

import numpy as np
from pydrake.solvers import ClarabelSolver, MathematicalProgram

from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.min_snap import TrajectoryOptimizationError
from airrace.vehicle import GRAVITY

_TRUST = 0.5  # of a duration, and of a speed, at first
_MISMATCH_COST = 2.0  # s per m/s of difference in velocity at a gate, in the merit
_ITERATIONS = 40


@dc.dataclass(frozen=True, eq=False)
class PointMassBound:
    """The quickest lap of a point mass.

    Attributes:
        duration: (s).
        durations: from each gate to the next, (n,) s.
        velocities: evenly in time over each leg, both ends included, (n,
            intervals + 1, 3) m/s.
        positions: at the gates, (n, 3) m.
        iterations: of the solver.
    """

    duration: float
    durations: np.ndarray
    velocities: np.ndarray
    positions: np.ndarray
    iterations: int


def point_mass_bound(gates: GateRegions, *, max_speed=None, max_acceleration=None,
                     max_specific_force=None, intervals: int = 32,
                     tolerance: float = 1e-4) -> PointMassBound:
    """Returns the quickest periodic lap of a point mass without drag.

    In time normalised to the leg, with w = T v, the acceleration u = T^2 a is
    constant over each of some intervals, and the limits |w| <= T v_max,
    |u| <= s a_max and |u + s g| <= s f_max are second-order cones in (w, u, T, s).
    Only s <= T^2 and w = T v at the gates are not convex; both are linearised
    about the last iterate until nothing changes. Speeds between the samples lie
    below those at the samples, so the result is a lap that can be flown; it
    approaches the least from above, by 0.02 % or so with 32 intervals.

    Args:
        gates: to pass.
        max_speed: (m/s). max_acceleration: without gravity (m/s^2).
        max_specific_force: greatest thrust over mass (m/s^2); give one of these
            two at least.
        intervals: of constant acceleration, a leg.
        tolerance: where to stop: relative change of the lap time.

    Raises:
        TrajectoryOptimizationError: if there is no such lap, or no limit.
    """
    limits = [x for x in (max_speed, max_acceleration, max_specific_force) if x is not None]
    if max_acceleration is None and max_specific_force is None:
        raise TrajectoryOptimizationError("Without a limit of acceleration or thrust, "
                                          "there is no quickest lap.")
    if not all(np.isfinite(x) and x > 0.0 for x in limits):
        raise TrajectoryOptimizationError("The limits must be positive.")
    if max_specific_force is not None and max_specific_force <= GRAVITY:
        raise TrajectoryOptimizationError("The greatest thrust is below the weight.")
    chords = np.roll(gates.midpoints, -1, axis=0) - gates.midpoints
    lengths = np.linalg.norm(chords, axis=1)
    a = max_acceleration if max_acceleration is not None else max_specific_force - GRAVITY
    speed = min(max_speed or np.inf, np.sqrt(a * lengths.mean()))
    T = lengths / speed
    directions = chords / lengths[:, None]
    V = directions + np.roll(directions, 1, axis=0)
    V *= speed / np.maximum(np.linalg.norm(V, axis=1, keepdims=True), 0.1)

    problem = _Problem(gates, intervals, max_speed, max_acceleration, max_specific_force)
    trust, merit = _TRUST, np.inf
    for iteration in range(1, _ITERATIONS + 1):
        found = problem.solve(T, V, trust, speed)
        if found is None:
            if trust > 4.0:
                break
            trust *= 2.0
            continue
        new_T, new_V, P, w = found
        # How far both legs at a gate disagree on its velocity.
        mismatch = np.linalg.norm(w[:, [0, -1]] - new_T[:, None, None] * np.stack(
            [new_V, np.roll(new_V, -1, axis=0)], axis=1), axis=2)
        new_merit = new_T.sum() + _MISMATCH_COST * np.sum(mismatch / new_T[:, None]) / speed
        if new_merit > merit * (1.0 + 1e-9):
            trust /= 3.0
            if trust < 1e-4:
                break
            continue
        done = merit - new_merit < tolerance * new_merit
        T, V, merit, best = new_T, new_V, new_merit, (w, P)
        if done:
            break
    if not np.isfinite(merit):
        raise TrajectoryOptimizationError("No lap of a point mass is within the limits.")
    w, P = best
    return PointMassBound(float(T.sum()), T, w / T[:, None, None], P, iteration)


class _Problem:
    """The convex problem about an iterate; its cones are always the same."""

    def __init__(self, gates, intervals, max_speed, max_acceleration, max_specific_force):
        n, N = len(gates.midpoints), intervals
        self._program = program = MathematicalProgram()
        self._w = program.NewContinuousVariables(3 * n * (N + 1)).reshape(n, N + 1, 3)
        self._P = program.NewContinuousVariables(n, 3)
        self._V = program.NewContinuousVariables(n, 3)
        self._T = program.NewContinuousVariables(n)
        self._s = program.NewContinuousVariables(n)
        program.AddLinearCost(np.ones(n), self._T)
        program.AddBoundingBoxConstraint(1e-3, np.inf, self._T)
        weights = np.full(N + 1, 1.0 / N)
        weights[[0, -1]] /= 2.0
        for i in range(n):
            gates.constrain(program, i, self._P[i], np.zeros(3))
            w, T, s = self._w[i], self._T[i], self._s[i]
            for j in range(3):
                program.AddLinearEqualityConstraint(
                    np.array([[*weights, 1.0, -1.0]]), np.zeros(1),
                    [*w[:, j], self._P[i, j], self._P[(i + 1) % n, j]])
            if max_speed is not None:
                A = np.diag([max_speed, 1.0, 1.0, 1.0])
                for k in range(N + 1):
                    program.AddLorentzConeConstraint(A, np.zeros(4), [T, *w[k]])
            for limit, gravity in ((max_acceleration, 0.0), (max_specific_force, GRAVITY)):
                if limit is not None:
                    A = np.zeros((4, 7))
                    A[0, 0], A[3, 0] = limit, gravity
                    A[1:, 1:4], A[1:, 4:] = -N * np.eye(3), N * np.eye(3)
                    for k in range(N):
                        program.AddLorentzConeConstraint(A, np.zeros(4), [s, *w[k], *w[k + 1]])
        self._linearized = []

    def solve(self, T, V, trust, speed):
        """Returns T (n,), V, P (n, 3) and w (n, intervals + 1, 3), or None."""
        program, n = self._program, len(T)
        for binding in self._linearized:
            program.RemoveConstraint(binding)
        add = []
        for i in range(n):
            add.append(program.AddLinearConstraint(
                np.array([[1.0, -2.0 * T[i]]]), [-np.inf], [-T[i] ** 2],
                [self._s[i], self._T[i]]))
            for k, g in ((0, i), (-1, (i + 1) % n)):
                A = np.hstack([np.eye(3), -T[i] * np.eye(3), -V[g][:, None]])
                add.append(program.AddLinearEqualityConstraint(
                    A, -T[i] * V[g], [*self._w[i, k], *self._V[g], self._T[i]]))
        add.append(program.AddBoundingBoxConstraint(
            T * (1 - min(trust, 0.9)), T * (1 + trust), self._T))
        add.append(program.AddBoundingBoxConstraint(
            V - trust * speed, V + trust * speed, self._V))
        self._linearized = add
        result = ClarabelSolver().Solve(program)
        if not result.is_success():
            return None
        get = result.GetSolution
        return get(self._T), get(self._V), get(self._P), get(self._w.reshape(-1, 3)).reshape(
            self._w.shape)
