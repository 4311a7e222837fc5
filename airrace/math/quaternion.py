"""Quaternions of rotations, [w, x, y, z] as Drake has them, for compiled functions."""

import math

import numpy as np

from airrace.common.jit import compilable


@compilable
def rotation_matrix(q: np.ndarray) -> np.ndarray:
    """Returns the rotation matrix, (3, 3), of a quaternion of any length, (4,)."""
    w, x, y, z = q
    s = 2.0 / (w * w + x * x + y * y + z * z)
    return np.array(
        (
            (1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)),
            (s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)),
            (s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)),
        )
    )


@compilable
def integrate(q: np.ndarray, w_W: np.ndarray, dt: float) -> np.ndarray:
    """Returns the unit quaternion of R_WB after a short time at constant angular velocity.

    It is the product of [1, w dt / 2] and q, normalised: exact to second order.

    Args:
        q: before, (4,).
        w_W: angular velocity in the world (rad/s), (3,).
        dt: may be negative (s).
    """
    w, x, y, z = q
    b, c, d = 0.5 * dt * w_W[0], 0.5 * dt * w_W[1], 0.5 * dt * w_W[2]
    w, x, y, z = (
        w - b * x - c * y - d * z,
        x + b * w + c * z - d * y,
        y + c * w + d * x - b * z,
        z + d * w + b * y - c * x,
    )
    length = math.sqrt(w * w + x * x + y * y + z * z)
    return np.array((w / length, x / length, y / length, z / length))
