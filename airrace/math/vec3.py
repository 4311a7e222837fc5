"""Products of vectors in three dimensions, for compiled functions, numbers and samples.

A vector is an array (3,), or (3, N) for N vectors at once. Sums have a fixed order: the last
digits of ``@``, and with them a race, depend on the processor that BLAS finds. The products are
those of triples.py, but what is a tuple there is an array here.
"""

from collections.abc import Callable

import numpy as np

from airrace.common.jit import compilable
from airrace.math import triples


def array_of(function: Callable[..., tuple]) -> Callable[..., np.ndarray]:
    """Returns a compilable function whose result is an array in place of a tuple."""

    def result_as_array(*arguments):
        return np.array(function(*arguments))

    # Numba keeps machine code by this name: it must be no other function's.
    result_as_array.__qualname__ = f"array_of_{function.__name__}"
    return compilable(result_as_array)


dot = triples.dot  # a . b, a number or (N,)
cross = array_of(triples.cross)  # a x b, (3,) or (3, N)
rotate = array_of(triples.rotate)  # R v, of a matrix (3, 3); (3,) or in Python (3, N)
