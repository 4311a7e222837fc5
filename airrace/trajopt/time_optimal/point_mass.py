"""The lap time of a point mass: what no vehicle with the same limits can beat."""

import dataclasses as dc

import numpy as np
from pydrake.solvers import MathematicalProgram

from airrace.trajopt.cone_solver import solve_cones
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.flight_limits import FlightConstraints, FlightLimits
from airrace.trajopt.gate_regions import GateRegions
from airrace.vehicle import GRAVITY

_TRUST, _MOST_TRUST = 0.5, 100.0  # of a duration, and of a speed: at first, and if none is found
_MISMATCH_COST = 2.0  # s per m/s of difference in velocity at a gate, in the merit
_NEARNESS_COST, _NEARNESS_MERIT = 4.0, 2.0  # s per metre nearer to a pylon than allowed
_ITERATIONS = 40
_SAMPLES = 4  # of the distance from pylons, in each interval
_BAND, _DEPTH = 3.0, 0.05  # m, of rows beyond the clearance, and the nearest point


@dc.dataclass(frozen=True, eq=False)
class PointMassBound:
    """The quickest lap of a point mass."""

    duration: float  #: s
    durations: np.ndarray  #: from each gate to the next, (legs,) s
    #: Evenly in time over each leg, both ends included, (legs, intervals + 1, 3) m/s.
    velocities: np.ndarray
    positions: np.ndarray  #: at the gates, (n, 3) m


def point_mass_bound(
    gates: GateRegions, constraints: FlightConstraints, intervals: int = 8, tolerance: float = 1e-3
) -> PointMassBound:
    """Returns the quickest lap of a point mass without drag: periodic, or from rest to rest.

    In time normalised to the leg, with w = T v, the acceleration u = T^2 a is
    constant over each of some intervals, and the limits |w| <= T v_max,
    |u| <= s a_max and |u + s g| <= s f_max are second-order cones in (w, u, T, s).
    Only s <= T^2 and w = T v at the gates are not convex; both are linearised
    about the last iterate until nothing changes. Speeds between the samples lie
    below those at the samples, so the result is a lap that can be flown; it
    approaches the least from above, by 0.02 % or so with 32 intervals. Pylons make
    it a local minimum: half planes about the last iterate keep it clear of them.

    Args:
        gates: to pass.
        constraints: to keep; of their limits speed, acceleration and specific force matter.
        intervals: of constant acceleration, a leg.
        tolerance: where to stop: relative change of the lap time.

    Raises:
        TrajectoryOptimizationError: if there is no such lap, or no limit.
    """
    limits = constraints.limits
    if np.isinf(limits.max_acceleration) and np.isinf(limits.max_specific_force):
        raise TrajectoryOptimizationError(
            "Without a limit of acceleration or thrust, there is no quickest lap."
        )
    if not (limits.max_speed > 0.0 and limits.max_acceleration > 0.0):
        raise TrajectoryOptimizationError("The limits must be positive.")
    if limits.max_specific_force <= GRAVITY:
        raise TrajectoryOptimizationError("The greatest thrust is below the weight.")
    after = gates.after
    chords = gates.midpoints[after] - gates.midpoints[: len(after)]
    lengths = np.linalg.norm(chords, axis=1)
    a = min(limits.max_acceleration, limits.max_specific_force - GRAVITY)
    speed = min(limits.max_speed, np.sqrt(a * lengths.mean()))
    T = lengths / speed
    directions = chords / lengths[:, None]
    V = np.zeros_like(gates.midpoints)
    V[: len(after)] = directions
    V[after] += directions
    V[list(gates.ends)] = 0.0
    V *= speed / np.maximum(np.linalg.norm(V, axis=1, keepdims=True), 0.1)

    problem = _Problem(gates, intervals, limits)
    near = _Pylons(constraints, intervals)
    trust, merit, best = _TRUST, np.inf, None
    for _ in range(_ITERATIONS):
        found = problem.solve(T, V, trust, speed, near, best)
        if found is None:
            if trust > _MOST_TRUST:
                break
            trust *= 2.0
            continue
        new_T, new_V, P, w = found
        lap_time, lack = new_T.sum(), _NEARNESS_MERIT * near.lack(w, P)
        # How far both legs at a gate disagree on its velocity.
        v_ends = np.stack([new_V[: len(after)], new_V[after]], axis=1)
        mismatch = np.linalg.norm(w[:, [0, -1]] - new_T[:, None, None] * v_ends, axis=2)
        new_merit = lap_time + _MISMATCH_COST * np.sum(mismatch / new_T[:, None]) / speed + lack
        # The first solution did not know of the pylons yet.
        first = best is None
        if not first and new_merit > merit * (1.0 + 1e-9):
            trust /= 3.0
            if trust < 1e-4:
                break
            continue
        done = not first and merit - new_merit < tolerance * new_merit
        T, V, merit, best = new_T, new_V, new_merit, (w, P)
        if done:
            break
    if best is None or not np.isfinite(merit):
        raise TrajectoryOptimizationError("No lap of a point mass is within the limits.")
    w, P = best
    return PointMassBound(float(T.sum()), T, w / T[:, None, None], P)


class _Pylons:
    """What a lap has to keep clear of."""

    def __init__(self, constraints: FlightConstraints, intervals: int):
        self._axes = np.reshape(constraints.pylons, (-1, 2))
        self._clearance = np.broadcast_to(constraints.clearance, len(self._axes))
        # From w, linear over each interval, to the path flown: integrals of hat functions.
        x = np.arange(1, _SAMPLES * intervals) / _SAMPLES
        u = np.clip(x[:, None] - np.arange(intervals + 1) + 1.0, 0.0, 2.0)
        hats = np.where(u < 1.0, u**2 / 2.0, 1.0 - (2.0 - u) ** 2 / 2.0)
        hats[:, 0] -= 0.5  # half of the first lies before the leg
        self._integrals = hats / intervals

    def _away(self, w, P):
        """Returns vectors from the axes, (n, samples, m, 2), and their lengths."""
        places = P[: len(w), None, :2] + self._integrals @ w[..., :2]
        away = places[:, :, None] - self._axes
        return away, np.maximum(np.linalg.norm(away, axis=3), 1e-6)

    def lack(self, w: np.ndarray, P: np.ndarray) -> float:
        """Returns by how much each leg comes too near, in all (m)."""
        _, distance = self._away(w, P)
        return float(np.max(self._clearance - distance, axis=(1, 2), initial=0.0).sum())

    def rows(self, w, P):
        """Yields legs, rows over x, y of P, w and a slack, and their least values."""
        away, distance = self._away(w, P)
        room = distance - self._clearance
        nearest = distance.min(axis=1, keepdims=True, initial=np.inf)
        for leg, near in enumerate((room < _BAND) & (distance < nearest + _DEPTH)):
            which, pylon = np.nonzero(near)
            if not len(which):
                continue
            normal = away[leg, which, pylon] / distance[leg, which, pylon][:, None]
            along = self._integrals[which]
            blocks = normal, normal[:, :1] * along, normal[:, 1:] * along, np.ones((len(which), 1))
            least = self._clearance[pylon] + np.sum(normal * self._axes[pylon], axis=1)
            yield leg, np.hstack(blocks), least


class _Problem:
    """The convex problem about an iterate; its cones are always the same."""

    def __init__(self, gates: GateRegions, intervals: int, limits: FlightLimits):
        self._after, N = gates.after, intervals
        n, places = len(self._after), len(gates.midpoints)
        self._program = program = MathematicalProgram()
        self._w = program.NewContinuousVariables(3 * n * (N + 1)).reshape(n, N + 1, 3)
        self._P = program.NewContinuousVariables(places, 3)
        self._V = program.NewContinuousVariables(places, 3)
        self._T = program.NewContinuousVariables(n)
        self._s = program.NewContinuousVariables(n)
        self._slack = program.NewContinuousVariables(n)
        program.AddLinearCost(np.ones(n), self._T)
        program.AddLinearCost(np.full(n, _NEARNESS_COST), self._slack)
        program.AddBoundingBoxConstraint(0.0, np.inf, self._slack)
        program.AddBoundingBoxConstraint(1e-3, np.inf, self._T)
        weights = np.full(N + 1, 1.0 / N)
        weights[[0, -1]] /= 2.0
        for i in gates.ends:
            gates.constrain(program, i, self._P[i], np.zeros(3))
            program.AddBoundingBoxConstraint(0.0, 0.0, self._V[i])
        for i in range(n):
            if i not in gates.ends:
                gates.constrain(program, i, self._P[i], np.zeros(3))
            w, T, s = self._w[i], self._T[i], self._s[i]
            for j in range(3):
                places = self._P[i, j], self._P[self._after[i], j]
                row = np.array([[*weights, 1.0, -1.0]])
                program.AddLinearEqualityConstraint(row, np.zeros(1), [*w[:, j], *places])
            if np.isfinite(limits.max_speed):
                A = np.diag([limits.max_speed, 1.0, 1.0, 1.0])
                for k in range(N + 1):
                    program.AddLorentzConeConstraint(A, np.zeros(4), [T, *w[k]])
            forces = (limits.max_acceleration, 0.0), (limits.max_specific_force, GRAVITY)
            for limit, gravity in forces:
                if np.isfinite(limit):
                    A = np.zeros((4, 7))
                    A[0, 0], A[3, 0] = limit, gravity
                    A[1:, 1:4], A[1:, 4:] = -N * np.eye(3), N * np.eye(3)
                    for k in range(N):
                        program.AddLorentzConeConstraint(A, np.zeros(4), [s, *w[k], *w[k + 1]])
        self._linearized = []

    def solve(self, T, V, trust, speed, near, last):
        """Returns T (n,), V, P (n, 3) and w (n, intervals + 1, 3), or None.

        Args: about: T, V. trust: of their change. near: _Pylons. last: w and P, or None.
        """
        program, n = self._program, len(T)
        for binding in self._linearized:
            program.RemoveConstraint(binding)
        add = []
        for i in range(n):
            at_most = program.AddLinearConstraint(
                np.array([[1.0, -2.0 * T[i]]]), [-np.inf], [-(T[i] ** 2)], [self._s[i], self._T[i]]
            )
            add.append(at_most)
            for k, g in ((0, i), (-1, self._after[i])):
                A = np.hstack([np.eye(3), -T[i] * np.eye(3), -V[g][:, None]])
                variables = [*self._w[i, k], *self._V[g], self._T[i]]
                add.append(program.AddLinearEqualityConstraint(A, -T[i] * V[g], variables))
        low, high = T * (1 - min(trust, 0.9)), T * (1 + trust)
        add.append(program.AddBoundingBoxConstraint(low, high, self._T))
        add.append(program.AddBoundingBoxConstraint(V - trust * speed, V + trust * speed, self._V))
        for leg, rows, least in near.rows(*last) if last is not None else ():
            w = self._w[leg]
            variables = [*self._P[leg, :2], *w[:, 0], *w[:, 1], self._slack[leg]]
            most = np.full(len(least), np.inf)
            add.append(program.AddLinearConstraint(rows, least, most, variables))
        self._linearized = add
        result = solve_cones(program)
        if not result.is_success():
            return None
        w = result.GetSolution(self._w.reshape(-1, 3)).reshape(self._w.shape)
        return *(result.GetSolution(each) for each in (self._T, self._V, self._P)), w
