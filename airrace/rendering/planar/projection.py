"""The pinhole camera: where things are in the picture, and what of them lies before the camera.

Points are relative to the camera, in world axes: p_CX_W (m). P = K R_CW takes them to homogeneous
pixels (u z, v z, z), where z is the depth: Hartley and Zisserman, Multiple View Geometry, (6.1).
"""

import typing

import numpy as np

from airrace.common.jit import compilable
from airrace.rendering.images import Box

NEAR = 0.05  # depth of the near plane: nothing before it is drawn (m)


class View(typing.NamedTuple):
    """A picture from one place."""

    P: np.ndarray  #: K R_CW, (3, 3)
    picture: Box  #: the Box of all its pixels
    parts: np.ndarray  #: those parts of it that are drawn, boxes (n, 4)


@compilable
def clip_near(points_h: np.ndarray, numbers: np.ndarray, corners: np.ndarray) -> int:
    """Clips a convex polygon at the near plane: Sutherland and Hodgman, CACM 17 (1974).

    Args:
        points_h: homogeneous pixels, (m, 3). numbers: which of them are its corners, (n,).
        corners: where to put those of what is left, (u, v), (n + 1, 2).

    Returns how many are left.
    """
    count = 0
    for i in range(len(numbers)):
        a, b = points_h[numbers[i]], points_h[numbers[(i + 1) % len(numbers)]]
        if a[2] >= NEAR:
            corners[count, 0], corners[count, 1] = a[0] / a[2], a[1] / a[2]
            count += 1
        if (a[2] >= NEAR) != (b[2] >= NEAR):
            share = (NEAR - a[2]) / (b[2] - a[2])
            corners[count, 0] = (a[0] + share * (b[0] - a[0])) / NEAR
            corners[count, 1] = (a[1] + share * (b[1] - a[1])) / NEAR
            count += 1
    return count


@compilable
def bounding_box(corners: np.ndarray, n: int, limits: Box) -> Box:
    """Returns the box that holds a polygon and its smooth edges, within limits.

    Args: corners: (n or more, 2) px. n: how many there are; none have an empty box.
    """
    u0, v0, u1, v1 = np.inf, np.inf, -np.inf, -np.inf
    for i in range(n):
        u0, v0 = min(u0, corners[i, 0]), min(v0, corners[i, 1])
        u1, v1 = max(u1, corners[i, 0]), max(v1, corners[i, 1])
    return Box(
        int(min(max(np.floor(u0) - 2, limits.x0), limits.x1)),
        int(min(max(np.floor(v0) - 2, limits.y0), limits.y1)),
        int(max(min(np.trunc(u1) + 3, limits.x1), limits.x0)),
        int(max(min(np.trunc(v1) + 3, limits.y1), limits.y0)),
    )
