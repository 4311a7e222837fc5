"""When a flight leads through a gate."""

import math

import numpy as np

from airrace.common.jit import compiled
from airrace.math.triples import added, difference, dot
from airrace.track.course import Opening

OPENING_SIZE = 15  # numbers of an Opening, as np.hstack() makes them an array


def as_opening(v: np.ndarray) -> Opening:
    """Returns the Opening of its numbers."""
    return Opening(v[0:3], v[3:6], v[6:9], v[9], v[10:13], v[13], v[14])


@compiled
def find(opening: np.ndarray, q: np.ndarray, p: np.ndarray) -> tuple[float, float]:
    """Returns where a straight line passes an opening from the front.

    It is the share of the line before the gate, 0 to 1, and the distance from the middle (m);
    NaN if the line does not pass.

    Args: opening: numbers of it, (OPENING_SIZE,). q, p: ends of the line (m), (3,), or NaN.
    """
    middle, forward, rightward, up = opening[0:3], opening[3:6], opening[6:9], opening[10:13]
    half_width, low, high = opening[9], opening[13], opening[14]
    before, after = dot(forward, difference(q, middle)), dot(forward, difference(p, middle))
    if not before < 0.0 <= after:
        return math.nan, math.nan
    share = before / (before - after)
    off = difference(added(q, share, difference(p, q)), middle)
    side, height = dot(rightward, off), dot(up, off)
    if abs(side) >= half_width or not low < height < high:
        return math.nan, math.nan
    return share, math.hypot(side, height)
