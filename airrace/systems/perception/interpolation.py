"""Grey levels between pixels."""

import numpy as np

from airrace.common.jit import compiled


def as_pixels(image) -> np.ndarray:
    """Returns a picture as compiled functions take it, (h, w), uint8; copied only if necessary."""
    return np.require(image, np.uint8, ["C", "W"])


@compiled
def grey_levels(image, x, y):
    """Returns the grey levels at points by bilinear interpolation, (n,).

    Args:
        image: (h, w), uint8; pixel centres are integers. Beyond the border, its levels go on.
        x, y: (px), (n,).
    """
    h, w = image.shape
    u, v, levels = np.empty(len(x)), np.empty(len(x)), np.empty(len(x))
    around = np.empty((4, len(x)), np.uint8)
    # In three loops: a processor computes many points at once, but fetches pixels one by one.
    for k in range(len(x)):
        # NaN becomes 0: no pixel outside of the image may be read.
        u[k] = min(x[k], w - 1.0) if x[k] > 0.0 else 0.0
        v[k] = min(y[k], h - 1.0) if y[k] > 0.0 else 0.0
    for k in range(len(x)):
        j, i = np.uint32(u[k]), np.uint32(v[k])
        right, below = min(j + 1, w - 1), min(i + 1, h - 1)
        around[0, k], around[1, k] = image[i, j], image[i, right]
        around[2, k], around[3, k] = image[below, j], image[below, right]
    for k in range(len(x)):
        share_x, share_y = u[k] - np.floor(u[k]), v[k] - np.floor(v[k])
        upper = around[0, k] + share_x * (float(around[1, k]) - around[0, k])
        lower = around[2, k] + share_x * (float(around[3, k]) - around[2, k])
        levels[k] = upper + share_y * (lower - upper)
    return levels
