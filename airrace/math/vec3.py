"""Products of vectors in three dimensions, for compiled functions, numbers and samples.

A vector is an array (3,), or (3, N) for N vectors at once. Sums have a fixed order: the last
digits of ``@``, and with them a race, depend on the processor that BLAS finds.
"""

import numpy as np

from airrace.common.jit import compilable


@compilable
def dot(a: np.ndarray, b: np.ndarray) -> float | np.ndarray:
    """Returns a . b, a number or (N,)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compilable
def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Returns a x b, (3,) or (3, N)."""
    return np.array(
        (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    )


@compilable
def rotate(R: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Returns R v, (3,), of a matrix (3, 3) and one vector."""
    return np.array((dot(R[0], v), dot(R[1], v), dot(R[2], v)))


@compilable
def rotate_each(R: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Returns R p, (n, 3), of a matrix (3, 3) and every point p of (n, 3)."""
    result = np.empty((len(points), 3))
    for i in range(len(points)):
        for k in range(3):
            result[i, k] = dot(R[k], points[i])
    return result


@compilable
def from_columns(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Returns the matrix with these columns, (3, 3)."""
    return np.array(((x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2])))
