"""Where a lap may cross its gates: windows or balls."""

import dataclasses as dc
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from pydrake.solvers import MathematicalProgram

from airrace.trajopt.errors import TrajectoryOptimizationError

_LEAST_DISTANCE = 0.1  # m, from gate to gate


@dc.dataclass(frozen=True, eq=False)
class GateRegions:
    """The gates of a lap, in racing order, and where each is crossed.

    Build it with windows() or balls().
    """

    midpoints: np.ndarray  #: (n, 3) m, in the world
    headings: np.ndarray  #: (n,) rad, unwrapped
    #: Of windows, to either side and up and down, (n, 2) m; None for balls.
    half_sizes: np.ndarray | None
    radius: float  #: of balls (m)

    @classmethod
    def windows(
        cls,
        midpoints: Sequence | np.ndarray,
        headings: ArrayLike,
        half_width: ArrayLike,
        half_height: ArrayLike,
    ) -> "GateRegions":
        """Returns gates to be crossed anywhere in an upright rectangle, or raises.

        Args:
            midpoints: (n, 3) m. headings: of flight, (n,) rad.
            half_width, half_height: of the rectangle, a number or (n,) m.
        """
        n = len(midpoints)
        sizes = np.column_stack([np.full(n, half_width, float), np.full(n, half_height, float)])
        for i in np.flatnonzero(~(sizes >= 0.0).all(axis=1)):
            raise TrajectoryOptimizationError(
                f"Gate {i + 1} leaves no room between its pylons; the vehicle is too large "
                "or its clearance is."
            )
        return cls(*_checked(midpoints, headings), sizes, 0.0)

    @classmethod
    def balls(cls, midpoints: ArrayLike, headings: ArrayLike, radius: float) -> "GateRegions":
        """Returns gates to be passed within a radius (m) of the midpoint; 0 is through it."""
        if not radius >= 0.0:
            raise TrajectoryOptimizationError(f"The radius of a ball is negative: {radius}.")
        return cls(*_checked(midpoints, headings), None, float(radius))

    @property
    def forward(self) -> np.ndarray:
        """Unit vectors of flight, (n, 3)."""
        c, s = np.cos(self.headings), np.sin(self.headings)
        return np.column_stack([c, s, np.zeros(len(c))])

    @property
    def rightward(self) -> np.ndarray:
        """Unit vectors to the right, (n, 3)."""
        c, s = np.cos(self.headings), np.sin(self.headings)
        return np.column_stack([s, -c, np.zeros(len(c))])

    @property
    def turn(self) -> float:
        """By how much yaw grows in a lap (rad), a multiple of 2 pi."""
        return turn_per_lap(self.headings)

    def constrain(
        self, program: MathematicalProgram, i: int, step: np.ndarray, point: np.ndarray
    ) -> None:
        """Adds to a MathematicalProgram that point + step lies in the region of gate i.

        Args: i: from 0. step: three variables. point: (3,) m.
        """
        offset = np.asarray(point) - self.midpoints[i]
        if self.half_sizes is not None:
            axes = np.array([self.forward[i], self.rightward[i], [0.0, 0.0, 1.0]])
            room = np.array([0.0, *self.half_sizes[i]])
            program.AddLinearConstraint(axes, -room - axes @ offset, room - axes @ offset, step)
        elif self.radius > 0.0:
            program.AddLorentzConeConstraint(
                np.vstack([np.zeros(3), np.eye(3)]), np.array([self.radius, *offset]), step
            )
        else:
            program.AddLinearEqualityConstraint(np.eye(3), -offset, step)

    def nearest(self, points: np.ndarray) -> np.ndarray:
        """Returns the points of the regions that are nearest to some points, (n, 3) m."""
        offset = np.asarray(points) - self.midpoints
        if self.half_sizes is not None:
            side = np.sum(offset * self.rightward, axis=1)
            side = np.clip(side, -self.half_sizes[:, 0], self.half_sizes[:, 0])
            up = np.clip(offset[:, 2], -self.half_sizes[:, 1], self.half_sizes[:, 1])
            offset = side[:, None] * self.rightward + up[:, None] * [0.0, 0.0, 1.0]
        else:
            distance = np.linalg.norm(offset, axis=1, keepdims=True)
            offset = offset * np.minimum(1.0, self.radius / np.maximum(distance, 1e-12))
        return self.midpoints + offset


def _checked(midpoints: ArrayLike, headings: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    midpoints, headings = np.array(midpoints, float), np.array(headings, float)
    if len(midpoints) < 2 or not (np.isfinite(midpoints).all() and np.isfinite(headings).all()):
        raise TrajectoryOptimizationError("A lap needs two gates or more, at finite places.")
    legs = np.linalg.norm(midpoints - np.roll(midpoints, 1, axis=0), axis=1)
    if legs.min() < _LEAST_DISTANCE:
        i = int(legs.argmin())
        raise TrajectoryOptimizationError(f"Gates {(i - 1) % len(legs) + 1} and {i + 1} coincide.")
    return midpoints, np.unwrap(headings)


def turn_per_lap(headings: np.ndarray) -> float:
    """Returns by how much yaw grows (rad) in a lap of headings (rad), (m,): a multiple of 2 pi."""
    closed = np.unwrap(np.append(headings, headings[0]))
    return float(2 * np.pi * np.round((closed[-1] - closed[0]) / (2 * np.pi)))
