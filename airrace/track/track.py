"""The race track: gates between pylons with marker boards, and its checks."""

import dataclasses as dc
import itertools
import math
from typing import ClassVar

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from airrace.track.course import Board, Course, Opening
from airrace.track.geometry import segment_distances
from airrace.track.start import Start, require

# What every pylon looks like (metres).
PYLON_HEIGHT = 12.0
PYLON_BASE_RADIUS = 1.7
PYLON_TIP_RADIUS = 0.15
BOARD_SIZE = 1.5
BOARD_HEIGHT = 6.25  # of the board's centre
BOARD_OFFSET = 1.0  # of a board's face from the pylon axis, to front and back
MOST_TURN = np.deg2rad(150.0)  # of a leg, off the headings of the gates at both of its ends
MARKER_SIZE = 1.2  # the black square; the rest is white border


@dc.dataclass
class Gate:
    """Two pylons and the direction of flight between them, see CourseGate.

    Its sides are the feet of the pylons; where to fly through it is at the height of the boards.
    """

    # Drake's YAML loader builds default objects first; check() refuses these.
    #: [x, y] of the left pylon's axis (m, world).
    left_pylon: list[float] = dc.field(default_factory=list)
    heading_deg: float = float("nan")  #: direction of flight through the gate (degrees from +x)
    pylon_spacing: float = 10.0  #: distance between the two pylon axes (m)

    height: ClassVar[float] = PYLON_HEIGHT

    @property
    def heading(self) -> float:
        return float(np.deg2rad(self.heading_deg))

    @property
    def forward(self) -> np.ndarray:
        return np.array([np.cos(self.heading), np.sin(self.heading), 0.0])

    @property
    def rightward(self) -> np.ndarray:
        return np.array([np.sin(self.heading), -np.cos(self.heading), 0.0])

    @property
    def width(self) -> float:
        return self.pylon_spacing

    @property
    def p_WL(self) -> np.ndarray:
        return np.array([*self.left_pylon, 0.0])

    @property
    def p_WR(self) -> np.ndarray:
        return self.p_WL + self.pylon_spacing * self.rightward

    @property
    def p_WG(self) -> np.ndarray:
        return (self.p_WL + self.p_WR) / 2 + [0.0, 0.0, BOARD_HEIGHT]

    def opening(self) -> Opening:
        """Returns the rectangle between the pylon axes, from the ground to the pylons' tips."""
        return Opening(
            middle=self.p_WG,
            forward=self.forward,
            rightward=self.rightward,
            half_width=self.pylon_spacing / 2,
            up=np.array([0.0, 0.0, 1.0]),
            low=-BOARD_HEIGHT,
            high=PYLON_HEIGHT - BOARD_HEIGHT,
        )

    def shifted(self, move: np.ndarray) -> "Gate":
        return dc.replace(self, left_pylon=(self.left_pylon + move).tolist())

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

    def check(self, number: int) -> None:
        require(len(self.left_pylon) == 2, f"left_pylon of gate {number} needs two numbers")
        numbers = [*self.left_pylon, self.heading_deg, self.pylon_spacing]
        require(np.all(np.isfinite(numbers)), f"a number of gate {number} is missing or not finite")
        least = 2 * PYLON_BASE_RADIUS + 1.0
        require(
            self.pylon_spacing >= least, f"the pylons of gate {number} are closer than {least} m"
        )


@dc.dataclass
class Track(Course):
    """A closed track of at least three gates of pylons; see Course."""

    name: str = ""
    start: Start = dc.field(default_factory=Start)
    hover_height: float = float("nan")
    gates: list[Gate] = dc.field(default_factory=list)

    closed = has_markers = True
    notes = """\
# World frame: x forward, y left, z up; metres and degrees. A gate's heading is the
# direction of flight through it; its right pylon stands pylon_spacing to the right of
# the left one. The pad descends by pad_tilt_deg in the direction pad_tilt_direction_deg.
"""
    _fewest_gates, _steepest_pad_deg = 3, 15.0

    def outline(self) -> np.ndarray:
        return self.pylons()

    def boards(self) -> list[Board]:
        return [b for n, gate in enumerate(self.gates) for b in gate.boards(n)]

    def pylons(self) -> np.ndarray:
        return np.array([p for gate in self.gates for p in (gate.p_WL, gate.p_WR)])

    def _check_layout(self) -> None:
        require(not math.isnan(self.hover_height), "hover_height is missing")
        require(
            0.5 <= self.hover_height < PYLON_HEIGHT,
            f"hover_height must lie between 0.5 and {PYLON_HEIGHT} m",
        )
        n, middle = len(self.gates), np.array([gate.p_WG[:2] for gate in self.gates])
        pylons = self.pylons()[:, :2]
        between_gates = segment_distances(pylons[::2], pylons[1::2])
        between_legs = segment_distances(middle, np.roll(middle, -1, axis=0))
        pairs = list(itertools.combinations(range(n), 2))
        for i, j in pairs:
            require(
                between_gates[i, j] > 2 * PYLON_BASE_RADIUS, f"gates {i + 1} and {j + 1} overlap"
            )
        for i, j in pairs:
            require(
                not 1 < j - i < n - 1 or between_legs[i, j] > 0,
                f"the track crosses itself after gates {i + 1} and {j + 1}",
            )
        self._check_turns(middle)
        start = np.array(self.start.position[:2])
        distance = np.linalg.norm(pylons - start, axis=1)
        nearest = int(np.argmin(distance))
        require(
            distance[nearest] > PYLON_BASE_RADIUS + 1.0,
            f"the start is too close to a pylon of gate {nearest // 2 + 1}",
        )

    def _check_turns(self, middle: np.ndarray) -> None:
        """Requires that no leg leads straight back: there a lap would turn in a gate's plane.

        Args: middle: of the gates, (n, 2) m.
        """
        forward = np.array([gate.forward[:2] for gate in self.gates])
        legs = np.roll(middle, -1, axis=0) - middle
        legs /= np.linalg.norm(legs, axis=1, keepdims=True)
        for i, leg in enumerate(legs):
            following = (i + 1) % len(legs)
            require(
                min(leg @ forward[i], leg @ forward[following]) >= np.cos(MOST_TURN),
                f"the leg from gate {i + 1} to gate {following + 1} leads straight back through "
                f"one of them: turn by less than {np.rad2deg(MOST_TURN):.0f} degrees off their "
                "headings",
            )
