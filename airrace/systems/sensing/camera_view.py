"""A picture whose parts are drawn when they are read."""

from collections.abc import Callable

import numpy as np

from airrace.common.immutable import Immutable
from airrace.common.jit import compiled

_TILE_W, _TILE_H = 16, 12  # what is drawn at least (px)


class CameraView(Immutable):
    """A picture in grey levels whose parts are drawn when they are read.

    The value of a pixel does not depend on what was read before, so that a view is a
    value like any picture; only the time it takes differs. A view of a picture that is
    complete already, such as one that was received: ``CameraView.of(picture)``.

    Attributes:
        shape: of the picture, (h, w).
        dtype: of its pixels, uint8 unless the picture it was made of is wrong.
    """

    def __init__(self, shape: tuple[int, int], draw: Callable[[np.ndarray, np.ndarray], None]):
        """Constructs the view.

        Args:
            shape: (h, w).
            draw: draws parts into an array of that shape, uint8; called with
                the array and boxes (n, 4), each x0, y0, x1, y1, see region(), none
                of which overlap.
        """
        self.shape, self.dtype = tuple(shape), np.dtype(np.uint8)
        self._draw: Callable | None = draw  # None: there is nothing left to draw
        self._pixels = np.empty(self.shape, np.uint8)
        h, w = self.shape
        self._missing = np.full((-(-h // _TILE_H), -(-w // _TILE_W)), True)

    @classmethod
    def of(cls, picture: np.ndarray) -> "CameraView":
        """Returns the view of an array, (h, w)."""
        view = cls.__new__(cls)
        view.shape, view.dtype, view._pixels = picture.shape, picture.dtype, picture
        view._draw, view._missing = None, np.zeros((0, 0), bool)
        return view

    def whole(self) -> np.ndarray:
        """Returns the picture, (h, w); not to be written to."""
        return self.drawn((0, 0, self.shape[1], self.shape[0]))

    def region(self, x0: int, y0: int, x1: int, y1: int) -> np.ndarray:
        """Returns columns x0 to x1 - 1 of rows y0 to y1 - 1; not to be written to.

        Args: as for a slice, all between 0 and the size.
        """
        return self.drawn((x0, y0, x1, y1))[y0:y1, x0:x1]

    def drawn(self, *regions: tuple[int, int, int, int]) -> np.ndarray:
        """Returns an array of the whole picture, (h, w), of which some regions are valid.

        Several regions at once are drawn faster than one after the other.

        Args: regions: each (x0, y0, x1, y1), see region().
        """
        if self._draw is not None:
            regions = np.array(regions, np.int64).reshape(-1, 4)
            boxes = _taken(self._missing, regions, *self.shape)
            if len(boxes):
                self._draw(self._pixels, boxes)
        return self._pixels


@compiled
def _taken(missing, regions, h, w):
    """Marks the missing tiles of some regions as drawn, and returns them.

    Args:
        missing: which tiles are; changed.
        regions: (n, 4), see CameraView.drawn().
        h, w: size of the picture.

    Returns: boxes of it, none of which overlap, (m, 4).
    """
    boxes, count = np.empty((missing.size, 4), np.int64), 0
    for x0, y0, x1, y1 in regions:
        x0, y0, x1, y1 = max(x0, 0), max(y0, 0), min(x1, w), min(y1, h)
        if x0 >= x1 or y0 >= y1:
            continue
        bottom, right = -(-y1 // _TILE_H), -(-x1 // _TILE_W)
        for i in range(y0 // _TILE_H, bottom):
            for j in range(x0 // _TILE_W, right):
                if not missing[i, j]:
                    continue
                # Extends to the right while tiles are missing, then down.
                i1, j1 = i + 1, j + 1
                while j1 < right and missing[i, j1]:
                    j1 += 1
                while i1 < bottom and missing[i1, j:j1].all():
                    i1 += 1
                missing[i:i1, j:j1] = False
                boxes[count, 0], boxes[count, 1] = _TILE_W * j, _TILE_H * i
                boxes[count, 2], boxes[count, 3] = min(_TILE_W * j1, w), min(_TILE_H * i1, h)
                count += 1
    return boxes[:count]
