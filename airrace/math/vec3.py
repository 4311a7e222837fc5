"""Products of vectors in three dimensions, for compiled functions, numbers and samples.

A vector is an array (3,), or (3, N) for N vectors at once. Sums have a fixed order: the last
digits of ``@``, and with them a race, depend on the processor that BLAS finds. The products are
those of triples.py, but what is a tuple there is an array here.
"""

from collections.abc import Callable

import numpy as np

from airrace.common.jit import compilable
from airrace.math import triples
from airrace.math.triples import dot


def array_of(function: Callable[..., tuple]) -> Callable[..., np.ndarray]:
    """Returns a compilable function whose result is an array in place of a tuple."""

    def result_as_array(*arguments):
        return np.array(function(*arguments))

    # Numba keeps machine code by this name: it must be no other function's.
    result_as_array.__qualname__ = f"array_of_{function.__name__}"
    return compilable(result_as_array)


cross = array_of(triples.cross)  # a x b, (3,) or (3, N)
rotate = array_of(triples.rotate)  # R v, (3,), of a matrix (3, 3) and one vector


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
