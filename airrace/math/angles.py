"""Angles."""

import math

from airrace.common.jit import compilable


@compilable
def wrap_angle(angle):
    """Returns an angle, or an array of them, turned by whole turns into [-pi, pi) (rad)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi
