"""What all kinds of courses have in common: everybody asks the course, nobody what kind it is."""

import abc
import dataclasses as dc
from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike
from pydrake.math import RigidTransform

from airrace.common.words import printable
from airrace.track.start import Start, require

if TYPE_CHECKING:
    from airrace.track.hall import Hall
    from airrace.track.square_gate import SquareGate

# m, of a coordinate: the ground of the simulation ends at 2 km, and beyond it a drone falls.
FARTHEST = 1500.0
MAX_GATES = 256  # DICT_ARUCO_ORIGINAL has 1024 markers, four a gate


class Box(NamedTuple):
    """A box of a frame, or of a hall."""

    X_WB: RigidTransform  #: pose of its middle
    size: np.ndarray  #: along its axes (m), (3,)


@dc.dataclass(frozen=True)
class Board:
    """One marker board."""

    #: The ArUco ID: 4n left front, 4n+1 left back, 4n+2 right front, 4n+3 right back of gate n,
    #: which counts from 0.
    id: int
    #: Pose of the marker frame M: origin at the board's centre, x to the right and y up as its
    #: viewer sees it, z out of the face.
    X_WM: RigidTransform


class Opening(NamedTuple):
    """The rectangle in which a gate counts."""

    middle: np.ndarray  #: p_WG of the gate (m), (3,)
    #: forward, rightward: unit vectors of flight, and in the opening to the right, (3,)
    forward: np.ndarray
    rightward: np.ndarray
    half_width: float  #: to the right and to the left of the middle (m)
    up: np.ndarray  #: unit vector in the opening, (3,)
    #: low, high: where it ends along that, from the middle (m)
    low: float
    high: float


class CourseGate(Protocol):
    """A gate of any kind, with a direction of flight through it.

    Attributes:
        heading: horizontal direction of flight (rad).
        forward, rightward: unit vectors of flight, and from the left to the right side, (3,).
        width, height: between its sides, and of all of it (m).
        p_WG, p_WL, p_WR: where to fly through it, and its left and its right side (m), (3,).
    """

    @property
    def heading(self) -> float: ...
    @property
    def forward(self) -> np.ndarray: ...
    @property
    def rightward(self) -> np.ndarray: ...
    @property
    def width(self) -> float: ...
    @property
    def height(self) -> float: ...
    @property
    def p_WG(self) -> np.ndarray: ...
    @property
    def p_WL(self) -> np.ndarray: ...
    @property
    def p_WR(self) -> np.ndarray: ...

    def opening(self) -> Opening:
        """Returns where a flight leads through it."""

    def shifted(self, move: np.ndarray) -> Self:
        """Returns the gate moved by x and y (m, world), (2,)."""

    def check(self, number: int) -> None:
        """Raises ValueError with one clause that says what is wrong with it as gate 1, 2, ..."""


class Course(abc.ABC):
    """A pad, gates in racing order, and what else stands there.

    A kind of courses is a dataclass, as its files are. What it does not have, such as markers, it
    has none of: no method needs to be asked for first.

    Attributes:
        name: what results are filed under.
        start: the pad.
        gates: in racing order.
        closed: whether it leads back to its first gate, in laps; if not, it is flown once.
        has_markers: whether its gates have boards with markers.
        notes: comment at the head of its files, which says what their numbers are.
    """

    name: str
    start: Start
    gates: Sequence[CourseGate]
    closed: ClassVar[bool]
    has_markers: ClassVar[bool]
    notes: ClassVar[str]
    _fewest_gates: ClassVar[int]
    _steepest_pad_deg: ClassVar[float]

    @property
    @abc.abstractmethod
    def hover_height(self) -> float:
        """Height of the first hover above the start (m)."""

    @abc.abstractmethod
    def outline(self) -> np.ndarray:
        """Returns points that the course lies between, (n, 3) m."""

    @abc.abstractmethod
    def _check_layout(self) -> None:
        """Raises ValueError, as check(), for what is wrong beyond start and single gates."""

    def pylons(self) -> np.ndarray:
        """Returns the feet of all pylons, left and right by turns, (2n, 3) m."""
        return np.empty((0, 3))

    def boards(self) -> list[Board]:
        """Returns all marker boards, ordered by ID."""
        return []

    def frames(self) -> "list[SquareGate]":
        """Returns all gates that are frames, in racing order."""
        return []

    def hall(self) -> "Hall | None":
        """Returns the hall around the course; None under the sky."""
        return None

    def way(self) -> np.ndarray:
        """Returns where a flight leads, (k, 3) m: from gate 1 to gate 1, or from the pad on."""
        gates = [gate.p_WG for gate in self.gates]
        return np.array([*gates, gates[0]] if self.closed else [self.start.position, *gates])

    def openings(self) -> np.ndarray:
        """Returns the openings of all gates as numbers, (n, 15); see gate_opening.py."""
        return np.array([np.hstack(gate.opening()) for gate in self.gates])

    def arena(self, margin: float) -> tuple[np.ndarray, np.ndarray]:
        """Returns the least x and y of the arena, (2,), and its greatest x, y and z, (3,) (m).

        Args: margin: how far it reaches beyond the outline, and above the ground (m).
        """
        outline = self.outline()[:, :2]
        return outline.min(0) - margin, np.append(outline.max(0) + margin, float(margin))

    def shifted(self, shifts: ArrayLike) -> Self:
        """Returns the course with every gate moved by x and y (m, world), (n, 2) or (2 n,)."""
        moves = np.reshape(shifts, (-1, 2))
        gates = [gate.shifted(move) for gate, move in zip(self.gates, moves, strict=True)]
        return dc.replace(self, gates=gates)  # type: ignore[type-var]

    def check(self) -> None:
        """Raises ValueError with one clause that says what is wrong."""
        require(self.name, "it has no name")
        require(self.name == printable(self.name), "its name has characters that are not seen")
        self.start.check(self._steepest_pad_deg)
        require(
            self._fewest_gates <= len(self.gates) <= MAX_GATES,
            f"a track needs at least {self._fewest_gates} gates and at most {MAX_GATES}, "
            f"not {len(self.gates)}",
        )
        for number, gate in enumerate(self.gates, 1):
            gate.check(number)
        farthest = np.abs([*self.outline(), self.start.position]).max()
        require(
            farthest <= FARTHEST,
            f"it reaches {farthest:.0f} m from the origin, and {FARTHEST:.0f} m is the most: take "
            "coordinates from a point near the start, not of a map such as UTM's",
        )
        self._check_layout()
