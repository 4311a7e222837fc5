"""Pictures of things before a background, drawn piece by piece."""

import functools

import numpy as np

from airrace.rendering.imaging.pixels import deep, whole
from airrace.rendering.planar.painting import WHOLE, paint


class Exposure:
    """The mean of pictures, any part of which can be drawn by itself.

    A pixel does not depend on what else is drawn, or when.
    """

    def __init__(self, weights, backdrop, look):
        """Constructs the exposure.

        Args:
            weights: of the pictures; they add up to 1.
            backdrop: what is behind the things, with paint(out, boxes).
            look: returns the things in some boxes, (n, 4), as Polygons.
        """
        self._shares, self._backdrop, self._look = _shares(tuple(weights)), backdrop, look

    def draw(self, out, boxes=None) -> None:
        """Draws it.

        Args:
            out: RGBA or grey levels, see pixels.py; overwritten.
            boxes: the parts to draw, none of which overlap; None: all of it.
        """
        boxes = np.array([whole(out)] if boxes is None else boxes, np.int64).reshape(-1, 4)
        out = deep(out)
        self._backdrop.paint(out, boxes)
        paint(out, boxes, self._look(boxes), self._shares)


@functools.lru_cache(maxsize=16)
def _shares(weights) -> np.ndarray:
    """Returns weights as whole numbers: it is quick to multiply and add bytes by them."""
    return np.diff(np.rint(WHOLE * np.cumsum([0.0, *weights]))).astype(np.uint16)
