"""Images, and boxes of pixels in them.

An image is uint8, RGBA, (h, w, 4), or grey levels, (h, w). The centre of pixel (u, v) has these
coordinates; its value is image[v, u]. Compiled functions take both kinds as (h, w, channels).
"""

import typing

import numpy as np
from numpy.typing import ArrayLike

from airrace.common.jit import compilable

LUMA = np.array([0.299, 0.587, 0.114])  # ITU-R BT.601, as OpenCV's


class Box(typing.NamedTuple):
    """Columns x0 to x1 - 1 of rows y0 to y1 - 1."""

    x0: int
    y0: int
    x1: int
    y1: int


@compilable
def intersection(a: Box | np.ndarray, b: Box | np.ndarray) -> Box:
    """Returns the pixels that are in both boxes, of which any may be an array, (4,)."""
    return Box(max(a[0], b[0]), max(a[1], b[1]), min(a[2], b[2]), min(a[3], b[3]))


@compilable
def is_empty(box: Box) -> bool:
    """Whether there is no pixel in a box."""
    return box.x0 >= box.x1 or box.y0 >= box.y1


@compilable
def touches(box: Box, boxes: np.ndarray) -> bool:
    """Whether a box shares a pixel with any of some others, (n, 4)."""
    for i in range(len(boxes)):
        if not is_empty(intersection(box, boxes[i])):
            return True
    return False


def whole_box(image: np.ndarray) -> Box:
    """Returns the box of all pixels of an image."""
    return Box(0, 0, image.shape[1], image.shape[0])


def crop(image: np.ndarray, box: Box) -> np.ndarray:
    """Returns the pixels in a box, not copied."""
    return image[box[1] : box[3], box[0] : box[2]]


def as_boxes(boxes: ArrayLike | None, image: np.ndarray) -> np.ndarray:
    """Returns boxes as an array, (n, 4); without any, that of all of the image."""
    return np.array([whole_box(image)] if boxes is None else boxes, np.int64).reshape(-1, 4)


def with_channels(image: np.ndarray) -> np.ndarray:
    """Returns an image as (h, w, channels), not copied."""
    return image[..., None] if image.ndim == 2 else image


def to_grey(color: ArrayLike) -> np.ndarray:
    """Returns the grey levels of colours, (..., 3)."""
    return np.asarray(color) @ LUMA


def colors_for(channels: int, colors: ArrayLike) -> np.ndarray:
    """Returns colours, RGB (n, 3), as images have them, (n, channels): grey, or opaque."""
    colors = np.asarray(colors, float)
    if channels == 1:
        return to_grey(colors)[:, None]
    return np.column_stack([colors, np.full(len(colors), 255.0)])
