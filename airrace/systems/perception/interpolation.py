"""Grey levels between pixels, in machine code, see compiled.py."""

import numpy as np

from airrace.common.jit import compiled


def as_pixels(image) -> np.ndarray:
    """Returns a picture as the functions in machine code take it, (h, w), uint8.

    It is copied only if it is no writable array in one piece.
    """
    return np.require(image, np.uint8, ["C", "W"])


@compiled
def grey_levels(image, x, y, levels) -> None:
    """Finds the levels at points, by bilinear interpolation; beyond the rim, the rim's.

    In three loops, as a processor computes many points at once, but fetches pixels one by one.

    Args:
        image: (h, w), uint8, in one piece; pixel centres are integers.
        x, y: (px), (n,).
        levels: where to put them, (n,).
    """
    h, w = image.shape
    flat, n = image.reshape(-1), len(x)
    right, down, places = np.empty(n), np.empty(n), np.empty(n, np.int32)
    around = np.empty((4, n), np.uint8)
    # A picture of one column or row has no other one beside it.
    aside, below = np.uint64(min(w - 1, 1)), np.uint64(w * min(h - 1, 1))
    for k in range(n):
        # Written so that NaN becomes 0: no such pixel must be looked at.
        u = min(x[k], w - 1.0) if x[k] > 0.0 else 0.0
        v = min(y[k], h - 1.0) if y[k] > 0.0 else 0.0
        j, i = np.int32(max(min(u, w - 2.0), 0.0)), np.int32(max(min(v, h - 2.0), 0.0))
        right[k], down[k], places[k] = u - j, v - i, i * np.int32(w) + j
    for k in range(n):
        place = np.uint64(places[k])
        around[0, k], around[1, k] = flat[place], flat[place + aside]
        place += below
        around[2, k], around[3, k] = flat[place], flat[place + aside]
    for k in range(n):
        upper = around[0, k] + right[k] * (float(around[1, k]) - float(around[0, k]))
        lower = around[2, k] + right[k] * (float(around[3, k]) - float(around[2, k]))
        levels[k] = upper + down[k] * (lower - upper)
