"""Pictures bent by a map: for every pixel, where in another picture to look."""

import cv2
import numpy as np

from airrace.common.jit import compiled
from airrace.rendering.imaging.pixels import part, whole


class PixelMap:
    """Where in a source each pixel of a picture comes from, interpolated bilinearly.

    Attributes:
        shape: of the picture, (h, w).
    """

    def __init__(self, u, v):
        """Args: u, v: the pixels of the source, (h, w); neighbours stay neighbours."""
        self.shape = u.shape
        # OpenCV bends grey pictures a tenth quicker by them than by its fixed-point maps.
        self._u, self._v = np.float32(u), np.float32(v)

    def source(self, box, size) -> tuple:
        """Returns the box of the source that a box of the picture shows.

        Args:
            box: see pixels.py.
            size: of the source, (w, h).
        """
        w, h = size
        u0, v0, u1, v1 = _extent(self._u, self._v, *box)
        # Two pixels at least for interpolation.
        x0, y0, x1, y1 = (max(int(end), 0) for end in (u0, v0, u1 + 2, v1 + 2))
        # Whole fours, in which pictures are drawn quickest.
        return x0 // 4 * 4, y0, min(-(-x1 // 4) * 4, w), min(y1, h)

    def bend(self, source, out, box=None) -> None:
        """Draws the picture, or a box of it; black and opaque where the source ends.

        Args:
            source, out: RGBA or grey levels, see pixels.py.
            box: the part to draw; None: all of it.
        """
        box = whole(out) if box is None else box
        cv2.remap(
            source,
            part(self._u, box),
            part(self._v, box),
            cv2.INTER_LINEAR,
            dst=part(out, box),
            borderValue=(0, 0, 0, 255),
        )


@compiled
def _extent(u, v, x0, y0, x1, y1):
    """Returns the least u and v and the greatest in a box: they are on its rim."""
    least_u, least_v, most_u, most_v = u[y0, x0], v[y0, x0], u[y0, x0], v[y0, x0]
    for y in range(y0, y1):
        for x in range(x0, x1, 1 if y == y0 or y == y1 - 1 else max(x1 - x0 - 1, 1)):
            least_u, most_u = min(least_u, u[y, x]), max(most_u, u[y, x])
            least_v, most_v = min(least_v, v[y, x]), max(most_v, v[y, x])
    return least_u, least_v, most_u, most_v
