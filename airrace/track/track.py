"""The race track: gates between pylons with marker boards, and its checks."""

import dataclasses as dc
import functools
import itertools
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import ArrayLike
from pydrake.math import RigidTransform, RotationMatrix

from airrace.common.errors import UserError
from airrace.common.resources import find_yaml, load_yaml
from airrace.track.geometry import segment_distances
from airrace.track.start import Start

# What every pylon looks like (metres).
PYLON_HEIGHT = 12.0
PYLON_BASE_RADIUS = 1.7
PYLON_TIP_RADIUS = 0.15
BOARD_SIZE = 1.5
BOARD_HEIGHT = 6.25  # of the board's centre
BOARD_OFFSET = 1.0  # of a board's face from the pylon axis, to front and back
MARKER_SIZE = 1.2  # the black square; the rest is white border
MAX_PAD_TILT_DEG = 15.0  # of the start; a drone may slip off a steeper one
SQUARE = "square"  # the kind of gates that are no pylons
MAX_GATES = 256  # DICT_ARUCO_ORIGINAL has 1024 markers, four a gate


@dc.dataclass(frozen=True)
class Board:
    """One marker board.

    Attributes:
        id: the ArUco ID: 4n left front, 4n+1 left back, 4n+2 right front,
            4n+3 right back of gate n = 0, 1, ...
        X_WM: pose of the marker frame M: origin at the board's centre, x to
            the right and y up as its viewer sees it, z out of the face.
    """

    id: int
    X_WM: RigidTransform


@dc.dataclass
class Gate:
    """Two pylons and the direction of flight between them.

    Attributes:
        left_pylon: [x, y] of the left pylon's axis (m, world).
        heading_deg: direction of flight through the gate (degrees from +x).
        pylon_spacing: distance between the two pylon axes (m).
    """

    # Drake's YAML loader builds default objects first; check() refuses these.
    left_pylon: list[float] = dc.field(default_factory=list)
    heading_deg: float = float("nan")
    pylon_spacing: float = 10.0

    @property
    def heading(self) -> float:
        """Direction of flight (rad)."""
        return float(np.deg2rad(self.heading_deg))

    @property
    def forward(self) -> np.ndarray:
        """Unit vector of flight, shape (3,), world."""
        return np.array([np.cos(self.heading), np.sin(self.heading), 0.0])

    @property
    def rightward(self) -> np.ndarray:
        """Unit vector from the left to the right pylon, shape (3,), world."""
        return np.array([np.sin(self.heading), -np.cos(self.heading), 0.0])

    @property
    def p_WL(self) -> np.ndarray:
        """Foot of the left pylon, shape (3,)."""
        return np.array([*self.left_pylon, 0.0])

    @property
    def p_WR(self) -> np.ndarray:
        """Foot of the right pylon, shape (3,)."""
        return self.p_WL + self.pylon_spacing * self.rightward

    @property
    def p_WG(self) -> np.ndarray:
        """Midpoint of the gate at the boards' height, shape (3,)."""
        return (self.p_WL + self.p_WR) / 2 + [0.0, 0.0, BOARD_HEIGHT]

    def boards(self, n: int) -> list[Board]:
        """Returns the four boards of this gate as number n = 0, 1, ..."""
        up = np.array([0.0, 0.0, 1.0])
        result = []
        for pylon, foot in enumerate((self.p_WL, self.p_WR)):
            for back in (0, 1):
                out = self.forward if back else -self.forward
                R_WM = RotationMatrix(np.column_stack([np.cross(up, out), up, out]))
                p_WM = foot + BOARD_OFFSET * out + BOARD_HEIGHT * up
                result.append(Board(4 * n + 2 * pylon + back, RigidTransform(R_WM, p_WM)))
        return result


@dc.dataclass
class Track:
    """A closed track; the gates are listed in racing order.

    Attributes:
        name: what results are filed under.
        start: the take-off pose.
        hover_height: height of the first hover above the start (m).
        gates: at least three.
    """

    name: str = ""
    start: Start = dc.field(default_factory=Start)
    hover_height: float = float("nan")
    gates: list[Gate] = dc.field(default_factory=list)

    @property
    def closed(self) -> bool:
        """Whether the track leads back to its first gate."""
        return True

    def outline(self) -> np.ndarray:
        """Returns points on the ground that the track lies between, (n, 3) m: all pylons' feet."""
        return self.pylons()

    def hall(self) -> None:
        """Returns None: there is no hall around tracks of pylons."""
        return None

    def boards(self) -> list[Board]:
        """Returns all marker boards, ordered by ID."""
        return [b for n, gate in enumerate(self.gates) for b in gate.boards(n)]

    def pylons(self) -> np.ndarray:
        """Returns the feet of all pylons, left and right by turns, (2n, 3)."""
        return np.array([p for gate in self.gates for p in (gate.p_WL, gate.p_WR)])

    def shifted(self, shifts: ArrayLike) -> "Track":
        """Returns the track with every gate moved.

        Args:
            shifts: x and y of each gate (m, world), (n, 2) or (2 n,).
        """
        moves = np.reshape(shifts, (-1, 2))
        gates = [
            dc.replace(gate, left_pylon=(gate.left_pylon + move).tolist())
            for gate, move in zip(self.gates, moves, strict=True)
        ]
        return dc.replace(self, gates=gates)

    def check(self) -> None:
        """Raises ValueError with one clause that says what is wrong."""
        _require(self.name, "it has no name")
        start = np.array([*self.start.position, self.start.heading_deg], float)
        _require(len(self.start.position) == 3, "start.position needs three numbers")
        _require(
            np.all(np.isfinite(start)),
            "start.position or start.heading_deg is missing or not finite",
        )
        _require(self.start.position[2] >= 0, "the start lies below the ground")
        _require(
            0.0 <= self.start.pad_tilt_deg <= MAX_PAD_TILT_DEG,
            f"start.pad_tilt_deg must lie between 0 and {MAX_PAD_TILT_DEG:.0f}",
        )
        _require(
            np.isfinite(self.start.pad_tilt_direction_deg),
            "start.pad_tilt_direction_deg is not finite",
        )
        _require(
            0.5 <= self.hover_height < PYLON_HEIGHT,
            f"hover_height must lie between 0.5 and {PYLON_HEIGHT} m",
        )
        _require(
            3 <= len(self.gates) <= MAX_GATES,
            f"a track needs at least 3 gates and at most {MAX_GATES}, not {len(self.gates)}",
        )
        for i, gate in enumerate(self.gates, 1):
            _require(len(gate.left_pylon) == 2, f"left_pylon of gate {i} needs two numbers")
            numbers = [*gate.left_pylon, gate.heading_deg, gate.pylon_spacing]
            _require(np.all(np.isfinite(numbers)), f"a number of gate {i} is missing or not finite")
            _require(
                gate.pylon_spacing >= 2 * PYLON_BASE_RADIUS + 1.0,
                f"the pylons of gate {i} are closer than {2 * PYLON_BASE_RADIUS + 1.0} m",
            )
        self._check_clearances()

    def _check_clearances(self):
        n, middle = len(self.gates), np.array([gate.p_WG[:2] for gate in self.gates])
        pylons = self.pylons()[:, :2]
        between_gates = segment_distances(pylons[::2], pylons[1::2])
        between_legs = segment_distances(middle, np.roll(middle, -1, axis=0))
        for i, j in itertools.combinations(range(n), 2):
            _require(
                between_gates[i, j] > 2 * PYLON_BASE_RADIUS, f"gates {i + 1} and {j + 1} overlap"
            )
            _require(
                not 1 < j - i < n - 1 or between_legs[i, j] > 0,
                f"the track crosses itself after gates {i + 1} and {j + 1}",
            )
        start = np.array(self.start.position[:2])
        distance = np.linalg.norm(pylons - start, axis=1)
        nearest = int(np.argmin(distance))
        _require(
            distance[nearest] > PYLON_BASE_RADIUS + 1.0,
            f"the start is too close to a pylon of gate {nearest // 2 + 1}",
        )


def load_track(name_or_file: str) -> Track:
    """Loads and checks a track.

    Args:
        name_or_file: the name of a shipped track or the path of a YAML file.

    Raises:
        UserError: if it is missing, malformed or impossible to fly.
    """
    path = find_yaml("tracks", name_or_file)
    if is_square(path):
        raise UserError(
            f"The track {path} has square gates, which have no markers to find: fly it with "
            f"`airrace grand-prix --track {name_or_file}`, or take a track of pylons."
        )
    # Kept, because both diagrams of a race load the track, and the checks take a while.
    return _load_track(path, path.stat().st_mtime_ns)


def is_square(path: Path) -> bool:
    """Whether a track's file says that its gates are square; without ``gate``, they are pylons.

    Raises:
        UserError: if it says that they are of another kind.
    """
    try:
        gate = _gate_of(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError):
        return False  # whoever loads it says what is wrong
    if gate is None:
        return False
    if isinstance(gate, dict) and gate.get("kind") == SQUARE:
        return True
    raise UserError(
        f"The track {path} has gates of an unknown kind: write gate: {{kind: {SQUARE}}}, or leave "
        "gate out for pylons."
    )


@functools.lru_cache(maxsize=8)
def _gate_of(text: str) -> object:
    """Returns what a track's file says below ``gate``; None if it is not there, or no YAML."""
    try:
        data = yaml.load(text, yaml.CSafeLoader)
    except (yaml.YAMLError, RecursionError, ValueError):
        return None
    return data.get("gate") if isinstance(data, dict) else None


@functools.lru_cache(maxsize=8)
def _load_track(path: Path, _mtime: int) -> Track:
    track = load_yaml(Track, filename=path)
    try:
        track.check()
    except ValueError as e:
        raise UserError(f"The track {path} cannot be raced: {e}.") from None
    return track


def _require(condition, message):
    if not condition:
        raise ValueError(message)
