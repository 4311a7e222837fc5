"""Grey levels between pixels."""

import numpy as np

from airrace.common.jit import compiled


def as_pixels(image: np.ndarray) -> np.ndarray:
    """Returns a picture as compiled functions take it, (h, w), uint8; copied only if necessary.

    To Numba, what is read-only is of another type, which it would compile everything for again.
    """
    return np.require(image, np.uint8, ["C", "W"])


@compiled
def grey_levels(image: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Returns the grey levels at points by bilinear interpolation, (n,).

    Args:
        image: (h, w), uint8; pixel centres are integers. Beyond the border, its levels go on.
        x, y: (px), (n,).
    """
    h, w = image.shape
    pixels, n = image.reshape(-1), len(x)
    share_x, share_y, levels = np.empty(n), np.empty(n), np.empty(n)
    place, around = np.empty(n, np.int32), np.empty((4, n), np.uint8)
    # A picture of one column or row has none beside it.
    right, below = np.uint64(min(w - 1, 1)), np.uint64(w * min(h - 1, 1))
    # In three loops: a processor computes many points at once, but fetches pixels one by one.
    for k in range(n):
        # NaN becomes 0: no pixel outside of the image may be read.
        u = min(x[k], w - 1.0) if x[k] > 0.0 else 0.0
        v = min(y[k], h - 1.0) if y[k] > 0.0 else 0.0
        j, i = np.int32(max(min(u, w - 2.0), 0.0)), np.int32(max(min(v, h - 2.0), 0.0))
        share_x[k], share_y[k], place[k] = u - j, v - i, i * np.int32(w) + j
    for k in range(n):
        at = np.uint64(place[k])
        around[0, k], around[1, k] = pixels[at], pixels[at + right]
        around[2, k], around[3, k] = pixels[at + below], pixels[at + below + right]
    for k in range(n):
        upper = around[0, k] + share_x[k] * (float(around[1, k]) - around[0, k])
        lower = around[2, k] + share_x[k] * (float(around[3, k]) - around[2, k])
        levels[k] = upper + share_y[k] * (lower - upper)
    return levels
