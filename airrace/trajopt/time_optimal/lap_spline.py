"""A lap, or a transition from state to state, as quintic splines between gates."""

import dataclasses as dc
import functools
from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from pydrake.math import BsplineBasis
from pydrake.trajectories import BsplineTrajectory

from airrace.common.immutable import read_only

DEGREE = 5
ORDERS = 5  # value, velocity, acceleration, jerk and snap, all continuous

# What is given of start and end of an open one, (2, 5, 4): of each order x, y, z and the angle.
_NONE, _XY, _XYZ, _XYZA = [0, 0, 0, 0], [1, 1, 0, 0], [1, 1, 1, 0], [1, 1, 1, 1]
# States in motion, with their thrusts and moments.
IN_MOTION = read_only([[_XYZA, _XYZA, _XYZA, _XYZ, _XYZ]] * 2, bool)
# Upright, and at rest: thrusts and moments may jump there. At the end any heading does.
AT_REST = read_only([[end, _XYZA, _XY, _XY, _NONE] for end in (_XYZA, _XYZ)], bool)
UNTURNED = read_only(np.eye(3))


@dc.dataclass(frozen=True, eq=False)
class LapSpline:
    """From gate to gate a B-spline of degree 5 with knots at equal times.

    It is continuous through the snap everywhere, and so is the lap, because both
    splines at a gate have the same five derivatives there. An open one starts and
    ends at two more places, which count as gates.

    Attributes:
        held: what is given of both ends of an open one, IN_MOTION or AT_REST.
        chart: the rotation after which the least rotation from the vertical to the thrust's axis
            says where the thrust-axis angle counts from: no flight may lead through the opposite
            of the vertical.
    """

    #: Value and four derivatives of x, y, z (m) and thrust-axis angle (rad; see
    #: thrust_axis_angle.py) at every gate, (n, 5, 4); of an open one (n + 1, 5, 4).
    gates: np.ndarray
    interior: np.ndarray  #: control points that are left between those, (n, m, 4)
    durations: np.ndarray  #: from each gate to the next, (n,) s
    turn: float  #: what all legs together add to that angle (rad)
    held: np.ndarray = dc.field(default_factory=lambda: IN_MOTION)
    chart: np.ndarray = dc.field(default_factory=lambda: UNTURNED)

    @classmethod
    def through(
        cls,
        positions: np.ndarray,
        velocities: np.ndarray,
        durations: np.ndarray,
        pieces: int,
        smoothness: float,
    ) -> "LapSpline":
        """Returns the lap that has positions at gates and nearly velocities in between.

        With one position more than there are legs, it is open, and at rest at both ends.

        It minimises the mean squared error of the velocity and a share of the
        squared snap. The angle is zero.

        Args:
            positions: at gates, (gates, 3) m.
            velocities: evenly in time over each leg, both ends included, (n, k, 3).
            durations: of legs, (n,) s.
            pieces: of each leg's spline, 5 or more.
            smoothness: the share, in sixth powers of the mean duration of a leg.
        """
        n, m, k = len(durations), pieces - ORDERS, velocities.shape[1]
        matrices, size = basis(pieces, tuple(np.linspace(0.0, 1.0, k))), ORDERS + m
        share = (smoothness * np.mean(durations) ** 6) ** 0.5
        is_closed = len(positions) == n
        total = n * size + (0 if is_closed else ORDERS)
        A, b = np.zeros((n, 2, k, total)), np.zeros((n, 2, k, 3))
        b[:, 0] = velocities
        for i, T in enumerate(durations):
            before, after = i * size, (i + 1) % len(positions) * size
            columns = [*range(before, before + size), *range(after, after + ORDERS)]
            powers = np.array([*T ** np.arange(ORDERS), *np.ones(m), *T ** np.arange(ORDERS)])
            A[i, 0][:, columns] = matrices[1] * powers / T
            A[i, 1][:, columns] = matrices[4] * powers * share / T**4
        A, b = A.reshape(-1, total), b.reshape(-1, 3)
        fixed = np.arange(len(positions)) * size
        free = np.setdiff1d(np.arange(total), fixed)
        b = b - A[:, fixed] @ positions
        if not is_closed:
            free = np.setdiff1d(free, [1, 2, 3, fixed[-1] + 1, fixed[-1] + 2, fixed[-1] + 3])
        A = A[:, free]
        scale = np.maximum(np.linalg.norm(A, axis=0), 1e-12)
        A = A / scale
        x = np.zeros((len(positions) * size, 3))
        x[fixed] = positions
        x[free] = np.linalg.solve(A.T @ A, A.T @ b) / scale[:, None]
        x = np.pad(x, ((0, 0), (0, 1))).reshape(-1, size, 4)
        return cls(x[:, :ORDERS], x[:n, ORDERS:], np.array(durations), 0.0, AT_REST)

    def fitted(
        self, wanted: np.ndarray, fractions: np.ndarray, weights: Sequence[float]
    ) -> "LapSpline":
        """Returns the lap whose control points between gates are the nearest to derivatives.

        Args:
            wanted: in normalised time, (orders, n, samples, 4).
            fractions: of the legs' durations, (samples,). weights: of the orders, (orders,).
        """
        matrices = basis(self.pieces, tuple(fractions))[: len(weights)]
        lap = dc.replace(self, interior=np.zeros_like(self.interior))
        rows = np.vstack([w * m[:, ORDERS:-ORDERS] for w, m in zip(weights, matrices)])
        missing = [w * m for w, m in zip(weights, wanted - lap.evaluate(matrices))]
        return dc.replace(lap, interior=np.linalg.pinv(rows) @ np.concatenate(missing, axis=1))

    @property
    def pieces(self) -> int:
        """Of each leg's spline."""
        return self.interior.shape[1] + ORDERS

    @property
    def duration(self) -> float:
        """Of the lap (s)."""
        return float(self.durations.sum())

    @property
    def is_closed(self) -> bool:
        """Whether the last leg leads to the first gate."""
        return len(self.gates) == len(self.durations)

    @property
    def can_be_slowed(self) -> bool:
        """Whether all of it can be flown slower: not if an end is in motion."""
        return self.is_closed or not np.any(self.gates[[0, -1], 1:][self.held[:, 1:]])

    @property
    def has_turn(self) -> bool:
        """Whether it is given how far its body turns."""
        return self.is_closed or bool(self.held[1, 0, 3])

    @property
    def after(self) -> np.ndarray:
        """Index of the gate at the end of every leg, (n,)."""
        return np.arange(1, len(self.durations) + 1) % len(self.gates)

    @property
    def passed(self) -> range:
        """Indices of the gates that are passed: not of the ends of an open one."""
        return range(0 if self.is_closed else 1, len(self.durations))

    def coefficients(self) -> np.ndarray:
        """Returns derivatives at both ends in normalised time, and what is between.

        Returns: (n, 10 + m, 4); derivative k at a gate times duration^k.
        """
        before, after = self.gates[: len(self.durations)], self.gates[self.after]
        if self.is_closed:
            after[-1, 0, 3] += self.turn
        powers = self.durations[:, None, None] ** np.arange(ORDERS)[:, None]
        return np.concatenate([before * powers, self.interior, after * powers], axis=1)

    def evaluate(self, matrices: np.ndarray) -> np.ndarray:
        """Returns derivatives with respect to normalised time, (orders, n, samples, 4).

        Args: matrices: of basis(), (orders, samples, 10 + m).
        """
        return matrices[:, None] @ self.coefficients()

    def with_turn(self, turn: float) -> "LapSpline":
        """Returns the lap with another angle in all.

        The difference is spread evenly; an open one takes it in its last leg, since
        what it has at its ends is given.
        """
        if not self.is_closed:
            gates = self.gates.copy()
            gates[-1, 0, 3] = gates[0, 0, 3] + turn
            return dc.replace(self, gates=gates, turn=turn)
        change = (turn - self.turn) / self.duration
        starts = np.concatenate([[0.0], np.cumsum(self.durations)[:-1]])
        gates, interior = self.gates.copy(), self.interior.copy()
        gates[:, 0, 3] += change * starts
        gates[:, 1, 3] += change
        # The control points of f(x) = x are averages of knots.
        averages = sliding_window_view(_knots(self.pieces)[1:-1], DEGREE).mean(axis=1)
        interior[..., 3] += change * self.sample_times(averages[ORDERS:-ORDERS])
        return dc.replace(self, gates=gates, interior=interior, turn=turn)

    def stepped(self, coefficients: np.ndarray, durations: np.ndarray, turn: float) -> "LapSpline":
        """Returns the lap with other coefficients.

        Both legs at a gate have their own idea of the derivatives there. Their mean
        is exact where all durations change alike. The ends of an open one keep theirs.

        Args: see coefficients() and the attributes.
        """
        powers = durations[:, None, None] ** np.arange(ORDERS)[:, None]
        start, end = coefficients[:, :ORDERS] / powers, coefficients[:, -ORDERS:] / powers
        before = np.roll(end, 1, axis=0)
        if self.is_closed:
            before[0, 0, 3] -= turn
            gates = (start + before) / 2.0
        else:
            gates = np.concatenate([start[:1], (start + before)[1:] / 2.0, end[-1:]])
            for i, held in zip((0, -1), self.kept):
                gates[i][held] = self.gates[i][held]
        interior = coefficients[:, ORDERS:-ORDERS]
        return dc.replace(self, gates=gates, interior=interior, durations=durations, turn=turn)

    @property
    def kept(self) -> np.ndarray:
        """What no step changes of both ends, (2, 5, 4): the last angle follows from the turn."""
        kept = self.held.copy()
        kept[1, 0, 3] = False
        return kept

    def dilated(self, factor: float) -> "LapSpline":
        """Returns the same path, flown in `factor` times the time, its ends included."""
        return dc.replace(
            self,
            durations=self.durations * factor,
            gates=self.gates / factor ** np.arange(ORDERS)[:, None],
        )

    def sample_times(self, fractions: np.ndarray) -> np.ndarray:
        """Returns the times of fractions of every leg, (n, samples) s."""
        starts = np.concatenate([[0.0], np.cumsum(self.durations)[:-1]])
        return starts[:, None] + self.durations[:, None] * np.asarray(fractions)


def _knots(pieces: int) -> np.ndarray:
    return np.concatenate([np.zeros(DEGREE), np.arange(pieces + 1) / pieces, np.ones(DEGREE)])


@functools.lru_cache(maxsize=64)
def basis(pieces: int, fractions: tuple) -> np.ndarray:
    """Returns what the coefficients of a leg give at fractions of its duration.

    Args: pieces: of the spline. fractions: of the leg, from 0 to 1.

    Returns:
        (5, samples, pieces + 5), from LapSpline.coefficients() to
        derivatives with respect to normalised time.
    """
    to_control = np.eye(pieces + DEGREE)
    spline = BsplineTrajectory(BsplineBasis(DEGREE + 1, _knots(pieces)), to_control)
    derivatives = [spline.MakeDerivative(k) for k in range(ORDERS)]
    starts, ends = (np.array([each.value(x)[:, 0] for each in derivatives]) for x in (0.0, 1.0))
    to_control[:ORDERS, :ORDERS] = np.linalg.inv(starts[:, :ORDERS])
    to_control[-ORDERS:, -ORDERS:] = np.linalg.inv(ends[:, -ORDERS:])
    result = np.array([each.vector_values(fractions).T for each in derivatives]) @ to_control
    result.setflags(write=False)
    return result
