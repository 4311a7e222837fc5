"""Grey levels between pixels, in machine code, see compiled.py."""

import numpy as np

from airrace.compiled import compiled


def as_pixels(image) -> np.ndarray:
    """Returns a picture as the functions in machine code take it, (h, w), uint8.

    It is copied only if it is no writable array in one piece.
    """
    return np.require(image, np.uint8, ["C", "W"])


@compiled
def grey_level(image, x, y):
    """Returns the level at a point, by bilinear interpolation; beyond the rim, the rim's.

    Args:
        image: (h, w), uint8; pixel centres are integers.
        x, y: (px).
    """
    h, w = image.shape
    # Written so that NaN becomes 0: no such pixel must be looked at.
    x = min(x, w - 1.0) if x > 0.0 else 0.0
    y = min(y, h - 1.0) if y > 0.0 else 0.0
    j, i = min(int(x), w - 2), min(int(y), h - 2)
    s, t = x - j, y - i
    upper = image[i, j] + s * (float(image[i, j + 1]) - float(image[i, j]))
    lower = image[i + 1, j] + s * (float(image[i + 1, j + 1]) - float(image[i + 1, j]))
    return upper + t * (lower - upper)
