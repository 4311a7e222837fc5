"""When a flight leads through a gate."""

import math

from airrace.track import PYLON_HEIGHT, Gate


class GateOpening:
    """The rectangle between the two pylon axes of a gate, above the ground, below their tips."""

    def __init__(self, gate: Gate):
        """Args: gate: where the track's file has it."""
        # Plain numbers: the referee asks at every step of the plant.
        self._p_WG = gate.p_WG.tolist()
        self._forward = gate.forward.tolist()
        self._rightward = gate.rightward.tolist()
        self._half = gate.pylon_spacing / 2

    def find(self, q, p, shift=(0.0, 0.0)) -> tuple[float, float] | None:
        """Returns where a straight line passes the gate from the front, None if it does not.

        Args:
            q, p: its ends, [x, y, z] (m); NaN passes nothing.
            shift: of the gate, [x, y] (m).

        Returns:
            (share, offset): of the line before the gate, 0 to 1, and the distance from the
            gate's midpoint (m).
        """
        x, y, z = self._p_WG
        p_WG = x, y, _ = x + shift[0], y + shift[1], z
        fx, fy, _ = self._forward
        before = fx * (q[0] - x) + fy * (q[1] - y)
        after = fx * (p[0] - x) + fy * (p[1] - y)
        if not before < 0.0 <= after:
            return None
        share = before / (before - after)
        at = [a + share * (b - a) for a, b in zip(q, p)]
        side = sum(r * (a - g) for r, a, g in zip(self._rightward, at, p_WG))
        if abs(side) >= self._half or not 0.0 < at[2] < PYLON_HEIGHT:
            return None
        return share, math.hypot(side, at[2] - z)
