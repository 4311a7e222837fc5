"""When a flight leads through the opening of a square gate."""

import math

import numpy as np

from airrace.common.jit import compiled
from airrace.math.vec3 import dot
from airrace.track.square_gate import INNER, SquareGate

OPENING_SIZE = 13  # numbers of an opening; those of other gates have fewer


def opening_numbers(gate: SquareGate) -> np.ndarray:
    """Returns what find_square() takes for a gate.

    Middle, direction of flight, direction to the right, direction up in the opening, and half of
    its side, (13,) m.
    """
    up = np.cross(gate.rightward, gate.forward)
    return np.array([*gate.p_WG, *gate.forward, *gate.rightward, *up, INNER / 2])


@compiled
def find_square(numbers: np.ndarray, q: np.ndarray, p: np.ndarray) -> tuple[float, float]:
    """Returns where a straight line passes the opening from the front.

    Args:
        numbers: of the opening, (13,).
        q, p: ends of the line (m), (3,); NaN passes nothing.

    Returns:
        the share of the line before the gate, 0 to 1, and the distance from the middle (m);
        NaN if the line does not pass.
    """
    middle, forward = numbers[0:3], numbers[3:6]
    before, after = dot(forward, q - middle), dot(forward, p - middle)
    if not before < 0.0 <= after:
        return math.nan, math.nan
    share = before / (before - after)
    off = q + share * (p - q) - middle
    side, height = dot(numbers[6:9], off), dot(numbers[9:12], off)
    if abs(side) >= numbers[12] or abs(height) >= numbers[12]:
        return math.nan, math.nan
    return share, math.hypot(side, height)
