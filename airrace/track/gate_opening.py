"""When a flight leads through a gate."""

import math
from collections.abc import Sequence

import numpy as np

from airrace.common.jit import compiled
from airrace.track.track import PYLON_HEIGHT, Gate


class GateOpening:
    """The rectangle between the two pylon axes of a gate, above the ground, below their tips.

    Attributes:
        numbers: what the function find() takes: midpoint, forward, rightward, and half the
            distance of the axes, (10,) m.
    """

    def __init__(self, gate: Gate):
        """Args: gate: where the track's file has it."""
        self.numbers = np.array(
            [*gate.p_WG, *gate.forward, *gate.rightward, gate.pylon_spacing / 2]
        )

    def find(
        self, q: np.ndarray, p: np.ndarray, shift: Sequence[float] | np.ndarray = (0.0, 0.0)
    ) -> tuple[float, float] | None:
        """Returns where a straight line passes the gate from the front, None if it does not.

        Args:
            q, p: its ends, [x, y, z] (m), (3,); NaN passes nothing.
            shift: of the gate, [x, y] (m).

        Returns:
            (share, offset): of the line before the gate, 0 to 1, and the distance from the
            gate's midpoint (m).
        """
        share, offset = find(self.numbers, q, p, float(shift[0]), float(shift[1]))
        return None if math.isnan(share) else (share, offset)


@compiled
def find(
    numbers: np.ndarray, q: np.ndarray, p: np.ndarray, shift_x: float, shift_y: float
) -> tuple[float, float]:
    """See GateOpening.find(); NaN if the line does not pass."""
    x, y, z, fx, fy, _, rx, ry, rz, half = numbers
    x, y = x + shift_x, y + shift_y
    before = fx * (q[0] - x) + fy * (q[1] - y)
    after = fx * (p[0] - x) + fy * (p[1] - y)
    if not before < 0.0 <= after:
        return math.nan, math.nan
    share = before / (before - after)
    dx = q[0] + share * (p[0] - q[0]) - x
    dy = q[1] + share * (p[1] - q[1]) - y
    height = q[2] + share * (p[2] - q[2])
    side = rx * dx + ry * dy + rz * (height - z)
    if abs(side) >= half or not 0.0 < height < PYLON_HEIGHT:
        return math.nan, math.nan
    return share, math.hypot(side, height - z)
