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


def heading(q: np.ndarray) -> float:
    """Returns the angle from the world's x axis to the body's, seen from above (rad).

    Args: q: of R_WB, of any length, (4,).
    """
    w, x, y, z = q
    return float(np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z))


@compilable
def rotation_between(q_1: np.ndarray, q_2: np.ndarray) -> np.ndarray:
    """Returns the rotation vector of R_1^T R_2 (rad), (3,), no longer than pi.

    It is twice the angle of the quaternion conj(q_1) q_2, along its axis (Sola, "Quaternion
    kinematics for the error-state Kalman filter", 2017, equation 105).

    Args:
        q_1, q_2: of R_1 and R_2, of any length, (4,).
    """
    a, b, c, d = q_1
    w, x, y, z = q_2
    v = np.array(
        (
            a * x - b * w - c * z + d * y,
            a * y + b * z - c * w - d * x,
            a * z - b * y + c * x - d * w,
        )
    )
    real = a * w + b * x + c * y + d * z
    if real < 0.0:  # q and -q are the same rotation
        real, v = -real, -v
    length = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if length < 1e-12 * real:  # the angle is the sine
        return 2.0 / real * v
    return 2.0 * math.atan2(length, real) / length * v


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


@compilable
def quaternion_product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Returns the quaternion of R(a) R(b), (4,)."""
    return np.array(
        (
            a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
            a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
            a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
            a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
        )
    )


@compilable
def exp_quaternion(vector: np.ndarray) -> np.ndarray:
    """Returns the unit quaternion of a rotation vector (rad), (4,); Sola 2017, eq. 101."""
    x, y, z = vector
    half = 0.5 * math.sqrt(x * x + y * y + z * z)
    s = 0.5 * (math.sin(half) / half if half > 1e-8 else 1.0)
    return np.array((math.cos(half), s * x, s * y, s * z))


@compilable
def turned(q: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Returns the unit quaternion of R exp(vector), (4,): a rotation in axes of the body."""
    result = quaternion_product(q, exp_quaternion(vector))
    return result / math.sqrt(np.sum(result * result))
