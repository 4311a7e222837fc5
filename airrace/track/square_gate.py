"""Square gates, as those of the AI Grand Prix: a frame that stands or hangs anywhere in space."""

import dataclasses as dc
from typing import ClassVar

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from airrace.track.course import Box, Opening
from airrace.track.start import require

# What every frame looks like (metres).
OUTER = 2.72  # side of the outer square
INNER = 1.5  # side of the opening
DEPTH = 0.26  # along the direction of flight
MAX_PITCH_DEG = 60.0
_LETTER = 0.34  # m, height of the lettering
_THIN = 0.008  # m, of a letter
# Strokes of the letters A, I and R, as they are read: left, bottom, right and top, in heights.
_STROKES = np.array(
    [(-1.1, 0.0, -0.9, 1.0), (-0.6, 0.0, -0.4, 1.0), (-0.9, 0.8, -0.6, 1.0), (-0.9, 0.4, -0.6, 0.6)]
    + [(-0.1, 0.0, 0.1, 1.0)]
    + [(0.4, 0.0, 0.6, 1.0), (0.6, 0.8, 1.1, 1.0), (0.9, 0.6, 1.1, 0.8), (0.6, 0.4, 1.1, 0.6)]
    + [(0.8, 0.0, 1.0, 0.4)]
)


@dc.dataclass
class SquareGate:
    """A square frame and the direction of flight through it, see CourseGate."""

    # Drake's YAML loader builds default objects first; check() refuses these.
    #: [x, y, z] of the middle of its opening (m, world).
    position: list[float] = dc.field(default_factory=list)
    yaw_deg: float = float("nan")  #: horizontal direction of flight (degrees from +x)
    pitch_deg: float = 0.0  #: by which that direction points down (degrees)

    height: ClassVar[float] = OUTER
    width: ClassVar[float] = OUTER

    @property
    def heading(self) -> float:
        return float(np.deg2rad(self.yaw_deg))

    @property
    def p_WG(self) -> np.ndarray:
        return np.array(self.position, float)

    @property
    def X_WG(self) -> RigidTransform:
        """Pose of the gate's frame G: x along the flight, y to the left, z up in the opening."""
        rpy = RollPitchYaw(0.0, float(np.deg2rad(self.pitch_deg)), self.heading)
        return RigidTransform(rpy, self.p_WG)

    @property
    def forward(self) -> np.ndarray:
        return self.X_WG.rotation().col(0)

    @property
    def rightward(self) -> np.ndarray:
        return -self.X_WG.rotation().col(1)

    @property
    def p_WL(self) -> np.ndarray:
        return self.p_WG - OUTER / 2 * self.rightward

    @property
    def p_WR(self) -> np.ndarray:
        return self.p_WG + OUTER / 2 * self.rightward

    def corners(self, side: float = OUTER) -> np.ndarray:
        """Returns the corners of a square of a side (m) about the gate's middle, (4, 3) m.

        The first is the upper left one, as its viewer in front of the gate sees it, and the
        others follow clockwise.
        """
        h = side / 2
        return (self.X_WG @ np.array([[0, h, h], [0, -h, h], [0, -h, -h], [0, h, -h]]).T).T

    def boxes(self) -> dict[str, Box]:
        """Returns what the frame consists of: its top, bottom, left and right."""
        width, middle = (OUTER - INNER) / 2, (OUTER + INNER) / 4
        places = {
            "top": ([0.0, 0.0, middle], [DEPTH, OUTER, width]),
            "bottom": ([0.0, 0.0, -middle], [DEPTH, OUTER, width]),
            "left": ([0.0, middle, 0.0], [DEPTH, width, INNER]),
            "right": ([0.0, -middle, 0.0], [DEPTH, width, INNER]),
        }
        return {
            name: Box(self.X_WG @ RigidTransform(p), np.array(size))
            for name, (p, size) in places.items()
        }

    def letters(self) -> list[Box]:
        """Returns the lettering on the top of its front and, read from there, of its back."""
        boxes, middle = [], (OUTER + INNER) / 4
        for side in (-1.0, 1.0):  # front and back: its reader's right is to -y and to +y
            for left, low, right, high in _STROKES * _LETTER:
                x, y = side * (DEPTH + _THIN) / 2, side * (left + right) / 2
                z = middle - _LETTER / 2 + (low + high) / 2
                size = np.array([_THIN, right - left, high - low])
                boxes.append(Box(self.X_WG @ RigidTransform([x, y, z]), size))
        return boxes

    def opening(self) -> Opening:
        return Opening(
            middle=self.p_WG,
            forward=self.forward,
            rightward=self.rightward,
            half_width=INNER / 2,
            up=np.cross(self.rightward, self.forward),
            low=-INNER / 2,
            high=INNER / 2,
        )

    def shifted(self, move: np.ndarray) -> "SquareGate":
        return dc.replace(self, position=(self.p_WG + [*move, 0.0]).tolist())

    def check(self, number: int) -> None:
        require(len(self.position) == 3, f"position of gate {number} needs three numbers")
        require(
            np.all(np.isfinite([*self.position, self.yaw_deg, self.pitch_deg])),
            f"a number of gate {number} is missing or not finite",
        )
        require(
            abs(self.pitch_deg) <= MAX_PITCH_DEG,
            f"pitch_deg of gate {number} must lie between -{MAX_PITCH_DEG:.0f} and "
            f"{MAX_PITCH_DEG:.0f}",
        )
        # Its middle is so high that the frame does not stick in the ground.
        require(self.p_WG[2] >= OUTER / 2, f"the frame of gate {number} sticks in the ground")
