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
    levels = np.empty(len(x))
    for k in range(len(x)):
        # NaN becomes 0: no pixel outside of the image may be read.
        u = min(x[k], w - 1.0) if x[k] > 0.0 else 0.0
        v = min(y[k], h - 1.0) if y[k] > 0.0 else 0.0
        j, i = int(u), int(v)
        right, below = min(j + 1, w - 1), min(i + 1, h - 1)
        upper = image[i, j] + (u - j) * (float(image[i, right]) - image[i, j])
        lower = image[below, j] + (u - j) * (float(image[below, right]) - image[below, j])
        levels[k] = upper + (v - i) * (lower - upper)
    return levels
