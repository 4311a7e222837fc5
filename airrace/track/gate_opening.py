"""When a flight leads through a gate."""

import math

import numpy as np

from airrace.common.jit import compilable, compiled
from airrace.math.vec3 import dot
from airrace.track.course import Opening

OPENING_SIZE = 15  # numbers of an Opening, as np.hstack() makes them an array


@compilable
def as_opening(v: np.ndarray) -> Opening:
    """Returns the Opening of its numbers."""
    return Opening(v[0:3], v[3:6], v[6:9], v[9], v[10:13], v[13], v[14])


@compilable
def _from(gate, p):
    """Returns p - p_WG as a triple: new arrays take time."""
    middle = gate.middle
    return p[0] - middle[0], p[1] - middle[1], p[2] - middle[2]


@compiled
def find(opening: np.ndarray, q: np.ndarray, p: np.ndarray) -> tuple[float, float]:
    """Returns where a straight line passes an opening from the front.

    Args:
        opening: numbers of the Opening, (OPENING_SIZE,).
        q, p: ends of the line (m), (3,); NaN passes nothing.

    Returns:
        the share of the line before the gate, 0 to 1, and the distance from the middle (m);
        NaN if the line does not pass.
    """
    gate = as_opening(opening)
    before, after = dot(gate.forward, _from(gate, q)), dot(gate.forward, _from(gate, p))
    if not before < 0.0 <= after:
        return math.nan, math.nan
    share = before / (before - after)
    off = _from(
        gate,
        (q[0] + share * (p[0] - q[0]), q[1] + share * (p[1] - q[1]), q[2] + share * (p[2] - q[2])),
    )
    side, height = dot(gate.rightward, off), dot(gate.up, off)
    if abs(side) >= gate.half_width or not gate.low < height < gate.high:
        return math.nan, math.nan
    return share, math.hypot(side, height)
