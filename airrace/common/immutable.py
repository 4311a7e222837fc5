"""Values that are shared instead of copied."""

from typing import Self

import numpy as np
from numpy.typing import ArrayLike


class Immutable:
    """Base of frozen dataclasses that cross abstract ports.

    Drake deep-copies abstract values with their Context, some twice an
    update. What cannot change need not be copied: a copy is the object itself.
    """

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict) -> Self:
        return self


def read_only(array: ArrayLike, dtype: type = float) -> np.ndarray:
    """Returns a read-only copy of the array."""
    result = np.array(array, dtype=dtype)
    result.setflags(write=False)
    return result
