"""Where a flight may cross its gates: windows, tilted polygons, prisms, or balls."""

import dataclasses as dc
import functools
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from pydrake.solvers import MathematicalProgram

from airrace.common.immutable import Immutable
from airrace.trajopt.cone_solver import solve_cones
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.feasibility import MAX_CROSSING_ANGLE

_LEAST_DISTANCE = 0.1  # m, from gate to gate
_UP = [0.0, 0.0, 1.0]


@dc.dataclass(frozen=True, eq=False)
class Region(Immutable):
    """Where a gate may be crossed: a ball, cut by half spaces and planes.

    These are the points of low <= A (p - midpoint) <= high within the radius.
    """

    midpoint: np.ndarray  #: (3,) m, in the world
    radius: float = np.inf  #: m
    A: np.ndarray = dc.field(default_factory=lambda: np.zeros((0, 3)))  #: (k, 3)
    #: low, high: (k,) m
    low: np.ndarray = dc.field(default_factory=lambda: np.zeros(0))
    high: np.ndarray = dc.field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        """Checks that there are such points.

        Raises:
            TrajectoryOptimizationError: if a size is negative or no number, or shapes are others.
        """
        k = len(self.A)
        shapes = [(3,), (k, 3), (k,), (k,)]
        if [np.shape(each) for each in (self.midpoint, self.A, self.low, self.high)] != shapes:
            raise TrajectoryOptimizationError(
                "A gate needs a midpoint of three numbers, and a low and a high for each row of A."
            )
        sizes = np.append(self.radius, self.high - self.low)
        if not (sizes >= 0.0).all() or not np.isfinite(self.A).all():
            raise TrajectoryOptimizationError(
                "A gate's radius, width, height or length is negative, or no number."
            )

    @classmethod
    def window(
        cls, midpoint: ArrayLike, heading: float, half_width: float, half_height: float
    ) -> "Region":
        """Returns an upright rectangle across a heading of flight (rad); its halves in m."""
        c, s, room = np.cos(heading), np.sin(heading), np.array([0.0, half_width, half_height])
        return cls(
            np.array(midpoint), A=np.array([[c, s, 0.0], [s, -c, 0.0], _UP]), low=-room, high=room
        )

    @classmethod
    def polygon(cls, corners: ArrayLike, length: float = 0.0) -> "Region":
        """Returns a flat convex polygon, however tilted, or the prism that it is the middle of.

        Args: corners: in order, (n, 3) m. length: of the prism, half of it on either side (m).

        Raises:
            TrajectoryOptimizationError: if they do not make one.
        """
        corners = np.array(corners, float)
        if corners.ndim != 2 or corners.shape[1:] != (3,) or len(corners) < 3:
            raise TrajectoryOptimizationError("A polygon needs three corners or more.")
        midpoint = corners.mean(axis=0)
        sides = np.roll(corners, -1, axis=0) - corners
        normal = np.sum(np.cross(corners - midpoint, sides), axis=0)
        normal = normal / max(np.linalg.norm(normal), 1e-12)
        outward = np.cross(sides, normal)
        outward = outward / np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)
        high = np.sum(outward * (corners - midpoint), axis=1)
        beyond = (corners - midpoint) @ np.column_stack([outward.T, normal, -normal])
        if not (beyond <= np.append(high, [0.0, 0.0]) + 1e-3).all() or not (high > 0.0).all():
            raise TrajectoryOptimizationError("The corners of a gate make no flat convex polygon.")
        low = np.append(np.full(len(high), -np.inf), -length / 2)
        high = np.append(high, length / 2)
        return cls(midpoint, A=np.vstack([outward, normal]), low=low, high=high)

    @classmethod
    def ball(cls, midpoint: ArrayLike, radius: float) -> "Region":
        """Returns a ball with a radius (m); 0 is its midpoint alone.

        Raises:
            TrajectoryOptimizationError: if the radius is negative.
        """
        if radius != 0.0:
            return cls(np.array(midpoint), float(radius))
        return cls(np.array(midpoint), A=np.eye(3), low=np.zeros(3), high=np.zeros(3))

    def constrain(self, program: MathematicalProgram, step: np.ndarray, point: np.ndarray) -> None:
        """Adds to a MathematicalProgram that point + step lies in the region.

        Args: step: three variables. point: (3,) m.
        """
        offset = np.asarray(point) - self.midpoint
        if len(self.A):
            at = self.A @ offset
            program.AddLinearConstraint(self.A, self.low - at, self.high - at, step)
        if np.isfinite(self.radius):
            program.AddLorentzConeConstraint(
                np.vstack([np.zeros(3), np.eye(3)]), np.array([self.radius, *offset]), step
            )

    def nearest(self, point: np.ndarray) -> np.ndarray:
        """Returns the point of the region that is nearest to a point, (3,) m."""
        offset = np.asarray(point) - self.midpoint
        if not len(self.A):
            distance = np.linalg.norm(offset)
            return self.midpoint + offset * np.minimum(1.0, self.radius / max(distance, 1e-12))
        if len(self.A) == 3 and np.allclose(self.A @ self.A.T, np.eye(3)):
            along = np.clip(np.sum(self.A * offset, axis=1), self.low, self.high)
            return self.midpoint + self.A.T @ along
        program = MathematicalProgram()
        step = program.NewContinuousVariables(3)
        self.constrain(program, step, point)
        program.AddQuadraticCost(np.eye(3), np.zeros(3), step, is_convex=True)
        result = solve_cones(program, tol_gap_abs=1e-12, tol_gap_rel=1e-12, tol_feas=1e-12)
        return np.asarray(point) + result.GetSolution(step)


@dc.dataclass(frozen=True, eq=False)
class GateRegions:
    """The gates of a lap, in racing order, and where each is crossed.

    Build it with windows() or balls(), or with of_regions() for gates of any kind. A region is
    where the drone's centre may be, so it is smaller than the opening. Start and goal of an open
    course are its first and its last gate. A gate may come twice, and from behind with the opposite
    heading.
    """

    regions: tuple  #: a Region each
    headings: np.ndarray  #: of flight, (n,) rad, unwrapped
    #: How far off its heading a gate may be crossed (rad); pi if its heading does not matter.
    most_off: float = MAX_CROSSING_ANGLE
    is_closed: bool = True  #: whether the last gate is followed by the first

    @classmethod
    def windows(
        cls,
        midpoints: Sequence | np.ndarray,
        headings: ArrayLike,
        half_width: ArrayLike,
        half_height: ArrayLike,
        between: ArrayLike | None = None,
    ) -> "GateRegions":
        """Returns gates to be crossed anywhere in an upright rectangle, or raises.

        Args:
            midpoints: (n, 3) m. headings: of flight, (n,) rad.
            half_width, half_height: of the rectangle, a number or (n,) m.
            between: see of_regions().
        """
        sizes = np.column_stack([_each(size, midpoints) for size in (half_width, half_height)])
        for i in np.flatnonzero(~(sizes >= 0.0).all(axis=1)):
            raise TrajectoryOptimizationError(
                f"Gate {i + 1} leaves no room between its pylons; the vehicle is too large "
                "or its clearance is."
            )
        headings = _unwrapped(_each(headings, midpoints))
        windows = [Region.window(p, h, *size) for p, h, size in zip(midpoints, headings, sizes)]
        return cls.of_regions(windows, headings, between)

    @classmethod
    def balls(
        cls,
        midpoints: ArrayLike,
        headings: ArrayLike | None,
        radius: ArrayLike,
        between: ArrayLike | None = None,
    ) -> "GateRegions":
        """Returns gates to be passed within a radius of the midpoint, or raises.

        Args:
            midpoints: (n, 3) m.
            headings: see of_regions().
            radius: a number or (n,) m; 0 is through the midpoint.
            between: see of_regions().
        """
        midpoints = np.asarray(midpoints, float)
        balls = [Region.ball(p, r) for p, r in zip(midpoints, _each(radius, midpoints))]
        return cls.of_regions(balls, headings, between)

    @classmethod
    def of_regions(
        cls,
        regions: Sequence[Region],
        headings: ArrayLike | None = None,
        between: ArrayLike | None = None,
    ) -> "GateRegions":
        """Returns gates of any kind, or raises.

        Args:
            regions: n of them.
            headings: of flight, (n,) rad; None if they may be passed in any direction.
            between: start and goal of an open course, (2, 3) m; None for a lap.

        Raises:
            TrajectoryOptimizationError: if there are too few, two that follow each other
                coincide, or there are not as many headings as gates, or not a start and a goal.
        """
        most_off = np.pi if headings is None else MAX_CROSSING_ANGLE
        headings = _unwrapped(_each(0.0 if headings is None else headings, regions))
        if between is not None:
            if np.shape(between) != (2, 3):
                raise TrajectoryOptimizationError(
                    "between needs a start and a goal, of three numbers each."
                )
            start, goal = (Region.ball(end, 0.0) for end in np.array(between, float))
            regions = start, *regions, goal
            headings = np.pad(headings, 1, mode="edge") if len(headings) else np.zeros(2)
        gates = cls(tuple(regions), headings, most_off, between is None)
        gates._check()
        return gates

    def _check(self) -> None:
        places = self.midpoints
        if len(places) < 2 or not (np.isfinite(places).all() and np.isfinite(self.headings).all()):
            raise TrajectoryOptimizationError("A lap needs two gates or more, at finite places.")
        names = [f"gate {i + 1}" for i in range(len(places))]
        if not self.is_closed:
            names = ["the start", *names[:-2], "the goal"]
        legs = np.linalg.norm(places[self.after] - places[: len(self.after)], axis=1)
        if legs.min() < _LEAST_DISTANCE:
            i = int(legs.argmin())
            pair = f"{names[i]} and {names[self.after[i]]}"
            raise TrajectoryOptimizationError(f"{pair[0].upper()}{pair[1:]} coincide.")

    def first(self, count: int, start: np.ndarray, heading: float) -> "GateRegions":
        """Returns a start, (3,) m, with a heading (rad), and the first gates after it, open."""
        regions = Region.ball(start, 0.0), *self.regions[:count]
        headings = np.append(heading, self.headings[:count])
        return GateRegions(regions, headings, self.most_off, is_closed=False)

    @functools.cached_property
    def midpoints(self) -> np.ndarray:
        """In the world, (n, 3) m."""
        return np.array([region.midpoint for region in self.regions], float).reshape(-1, 3)

    @property
    def after(self) -> np.ndarray:
        """Index of the gate at the end of every leg, (legs,)."""
        n = len(self.regions)
        return np.arange(1, n + self.is_closed) % n

    @property
    def ends(self) -> tuple:
        """Indices of start and goal; none of a lap."""
        return () if self.is_closed else (0, len(self.regions) - 1)

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
        """Adds that point + step lies in the region of gate i, from 0; see Region.constrain()."""
        self.regions[i].constrain(program, step, point)

    def nearest(self, points: np.ndarray) -> np.ndarray:
        """Returns the points of the regions that are nearest to some points, (n, 3) m."""
        return np.array([each.nearest(point) for each, point in zip(self.regions, points)])


def _each(values: ArrayLike, gates: Sequence | np.ndarray) -> np.ndarray:
    """Returns a value for each gate, (n,), of one for all or for each; or raises."""
    if np.shape(values) not in ((), (len(gates),)):
        raise TrajectoryOptimizationError(
            f"There must be one heading or size for each of {len(gates)} gates, "
            f"not {np.size(values)}."
        )
    return np.full(len(gates), values, float)


def _unwrapped(headings: ArrayLike) -> np.ndarray:
    return np.unwrap(np.array(headings, float))


def turn_per_lap(headings: np.ndarray) -> float:
    """Returns by how much yaw grows (rad) in a lap of headings (rad), (m,): a multiple of 2 pi."""
    closed = np.unwrap(np.append(headings, headings[0]))
    return float(2 * np.pi * np.round((closed[-1] - closed[0]) / (2 * np.pi)))
