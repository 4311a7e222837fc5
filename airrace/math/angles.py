"""Angles."""

import math

import numpy as np

from airrace.common.jit import compilable


@compilable
def wrap_angle(angle: float | np.ndarray) -> float | np.ndarray:
    """Returns an angle, or an array of them, turned by whole turns into [-pi, pi) (rad)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi
