"""Pictures in colour, RGBA, (h, w, 4), or in grey levels, (h, w); both uint8.

A box is a part of one: columns from x0 to x1 - 1 and rows from y0 to y1 - 1, as
(x0, y0, x1, y1).
"""

import cv2
import numpy as np

_LUMA = np.array([0.299, 0.587, 0.114])  # ITU-R BT.601, as OpenCV's


def is_grey(image) -> bool:
    """Whether a picture has grey levels only."""
    return image.ndim == 2


def to_grey(color):
    """Returns the grey levels of colours, (..., 3)."""
    return np.asarray(color) @ _LUMA


def whole(image) -> tuple:
    """Returns the box that is all of a picture."""
    return 0, 0, image.shape[1], image.shape[0]


def part(image, box) -> np.ndarray:
    """Returns the pixels in a box, not copied."""
    x0, y0, x1, y1 = box
    return image[y0:y1, x0:x1]


def fill(image, color) -> None:
    """Fills a picture with a colour, RGB, (3,)."""
    image[:] = to_grey(color) if is_grey(image) else (*color, 255)


def fill_polygons(image, polygons, colors, shift: int) -> None:
    """Draws convex polygons with smooth edges, in order.

    Args:
        image: to draw into.
        polygons: corners of each, (n, 2), int32, with ``shift`` fractional bits.
        colors: RGB of each, (number of polygons, 3).
    """
    if is_grey(image):
        values = to_grey(colors).tolist()
    else:
        values = [(*color, 255) for color in np.asarray(colors).tolist()]
    for polygon, value in zip(polygons, values):
        if len(polygon):
            cv2.fillConvexPoly(image, polygon, value, cv2.LINE_AA, shift)


def blend(image, levels, alpha) -> None:
    """Lays grey levels over a picture, which stays opaque.

    Args:
        image: changed in place.
        levels: already multiplied by alpha / 255, (h, w), uint8.
        alpha: opacity, (h, w), uint8.
    """
    rest = cv2.bitwise_not(alpha)
    if not is_grey(image):
        # cvtColor makes the fourth channel 255.
        rest = cv2.cvtColor(rest, cv2.COLOR_GRAY2RGBA)
        levels = cv2.cvtColor(levels, cv2.COLOR_GRAY2RGBA)
    cv2.multiply(image, rest, dst=image, scale=1 / 255)
    cv2.add(image, levels, dst=image)
