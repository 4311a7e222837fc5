"""Polygons in homogeneous pixel coordinates."""

import numpy as np

NEAR = 0.05  # nothing nearer to the camera than this is drawn (m)
SHIFT = 4  # fractional bits of the coordinates OpenCV draws with


def clip_near(points_h) -> np.ndarray:
    """Returns the part of a convex polygon in front of the near plane.

    Args:
        points_h: corners (u z, v z, z), (n, 3): pixel times depth, and depth.

    Returns:
        Corners in the same coordinates, (m, 3), m = 0 if nothing is left.
    """
    result = []
    for a, b in zip(points_h, np.roll(points_h, -1, axis=0)):
        if a[2] >= NEAR:
            result.append(a)
        if (a[2] >= NEAR) != (b[2] >= NEAR):
            result.append(a + (NEAR - a[2]) / (b[2] - a[2]) * (b - a))
    return np.array(result).reshape(-1, 3)


def to_pixels(points_h) -> np.ndarray:
    """Returns (u, v) for corners (u z, v z, z); z must be positive."""
    return points_h[..., :2] / points_h[..., 2:]


def to_fixed(pixels) -> np.ndarray:
    """Returns pixel coordinates as OpenCV's drawing functions want them."""
    return np.round(pixels * (1 << SHIFT)).astype(np.int32)
