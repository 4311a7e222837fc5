"""Values that are shared instead of copied."""

import numpy as np


class Immutable:
    """Base of frozen dataclasses that cross abstract ports.

    Drake deep-copies abstract values with their Context, some twice an
    update. What cannot change need not be copied: a copy is the object itself.
    """

    def __copy__(self):
        return self

    def __deepcopy__(self, memo):
        return self


def read_only(array, dtype=float) -> np.ndarray:
    """Returns a read-only copy of the array."""
    result = np.array(array, dtype=dtype)
    result.setflags(write=False)
    return result
