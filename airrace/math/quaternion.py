"""Quaternions of rotations, [w, x, y, z] as Drake has them, for compiled functions."""

import numpy as np

from airrace.common.jit import compilable
from airrace.math import triples


@compilable
def rotation_matrix(q: np.ndarray) -> np.ndarray:
    """Returns the rotation matrix, (3, 3), of a quaternion of any length, (4,)."""
    return np.array(triples.rotation_rows(q))


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
    return np.array(triples.rotation_between(q_1, q_2))


@compilable
def integrate(q: np.ndarray, w_W: np.ndarray, dt: float) -> np.ndarray:
    """Returns the unit quaternion of R_WB after a short time at constant angular velocity.

    It is the product of [1, w dt / 2] and q, normalised: exact to second order.

    Args:
        q: before, (4,).
        w_W: angular velocity in the world (rad/s), (3,).
        dt: may be negative (s).
    """
    return np.array(triples.integrate(q, w_W, dt))


@compilable
def quaternion_product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Returns the quaternion of R(a) R(b), (4,)."""
    return np.array(triples.quaternion_product(a, b))


@compilable
def exp_quaternion(vector: np.ndarray) -> np.ndarray:
    """Returns the unit quaternion of a rotation vector (rad), (4,)."""
    return np.array(triples.exp_quaternion(vector))


@compilable
def turned(q: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Returns the unit quaternion of R exp(vector), (4,): a rotation in axes of the body."""
    return np.array(triples.turned(q, vector))
