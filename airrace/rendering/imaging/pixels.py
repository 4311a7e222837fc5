"""Pictures in colour, RGBA, (h, w, 4), or in grey levels, (h, w); both uint8.

A box is a part of one: columns from x0 to x1 - 1 and rows from y0 to y1 - 1, as
(x0, y0, x1, y1). Compiled functions take both kinds of pictures as (h, w, channels).
"""

import numpy as np

LUMA = np.array([0.299, 0.587, 0.114])  # ITU-R BT.601, as OpenCV's


def is_grey(image) -> bool:
    """Whether a picture has grey levels only."""
    return image.ndim == 2


def to_grey(color):
    """Returns the grey levels of colours, (..., 3)."""
    return np.asarray(color) @ LUMA


def colors_for(channels: int, colors) -> np.ndarray:
    """Returns colours, RGB (n, 3), as they are in pictures, (n, channels): grey, or opaque."""
    colors = np.asarray(colors, float)
    if channels == 1:
        return to_grey(colors)[:, None]
    return np.column_stack([colors, np.full(len(colors), 255.0)])


def deep(image) -> np.ndarray:
    """Returns a picture as (h, w, channels), not copied."""
    return image[..., None] if is_grey(image) else image


def whole(image) -> tuple:
    """Returns the box that is all of a picture."""
    return 0, 0, image.shape[1], image.shape[0]


def part(image, box) -> np.ndarray:
    """Returns the pixels in a box, not copied."""
    x0, y0, x1, y1 = box
    return image[y0:y1, x0:x1]
