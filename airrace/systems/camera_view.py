"""Pictures that are drawn where somebody looks."""

import numpy as np

from airrace.immutable import Immutable

_TILE_W, _TILE_H = 64, 48  # what is drawn at least (px)


class CameraView(Immutable):
    """A picture in grey levels whose parts are drawn when they are asked for.

    What a pixel shows does not depend on who asked for what before, so that a
    view is a value like any picture; only the time it takes differs. A view of
    a picture that is there already, such as one that came over a cable:
    ``CameraView.of(picture)``.

    Attributes:
        shape: of the picture, (h, w).
        dtype: of its pixels, uint8 unless the picture it was made of is wrong.
    """

    def __init__(self, shape, draw):
        """Constructs the view.

        Args:
            shape: (h, w).
            draw: draws parts into an array of that shape, uint8; called with
                the array and a list of (x0, y0, x1, y1), see region(), none of
                which overlap.
        """
        self.shape, self.dtype = tuple(shape), np.dtype(np.uint8)
        self._draw = draw
        self._pixels = np.zeros(self.shape, np.uint8)
        h, w = self.shape
        self._missing = np.ones((-(-h // _TILE_H), -(-w // _TILE_W)), bool)

    @classmethod
    def of(cls, picture) -> "CameraView":
        """Returns the view of an array, (h, w)."""
        view = cls.__new__(cls)
        view.shape, view.dtype, view._pixels = picture.shape, picture.dtype, picture
        view._missing = np.zeros((1, 1), bool)
        return view

    @property
    def is_complete(self) -> bool:
        """Whether all of it has been drawn already, so that whole() costs nothing."""
        return not self._missing.any()

    def whole(self) -> np.ndarray:
        """Returns the picture, (h, w); not to be written to."""
        return self.drawn((0, 0, self.shape[1], self.shape[0]))

    def region(self, x0: int, y0: int, x1: int, y1: int) -> np.ndarray:
        """Returns columns x0 to x1 - 1 of rows y0 to y1 - 1; not to be written to.

        Args: as for a slice, all between 0 and the size.
        """
        return self.drawn((x0, y0, x1, y1))[y0:y1, x0:x1]

    def drawn(self, *regions) -> np.ndarray:
        """Returns an array of the whole picture, (h, w), of which some regions are valid.

        For who needs pixels at the places that they have in the picture, or more
        than one region: all at once are drawn faster than one after the other.

        Args:
            regions: each (x0, y0, x1, y1), see region().
        """
        boxes = []
        for x0, y0, x1, y1 in regions:
            i, j = y0 // _TILE_H, x0 // _TILE_W
            boxes += self._taken(i, j, -(-y1 // _TILE_H), -(-x1 // _TILE_W))
        if boxes:
            h, w = self.shape
            self._draw(self._pixels, [
                (_TILE_W * j0, _TILE_H * i0, min(_TILE_W * j1, w), min(_TILE_H * i1, h))
                for i0, j0, i1, j1 in boxes
            ])
        return self._pixels

    def _taken(self, i0, j0, i1, j1) -> list:
        """Takes what is missing out of some tiles; returns it as blocks of tiles."""
        tiles = self._missing[i0:i1, j0:j1]
        if not tiles.any():
            return []
        if tiles.all():
            blocks = [(i0, j0, i1, j1)]
        else:
            blocks = []  # column by column, as some of it was drawn before
            for j, column in enumerate(tiles.T, start=j0):
                rows = i0 + np.flatnonzero(column)
                for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
                    if len(run):
                        blocks.append((int(run[0]), j, int(run[-1]) + 1, j + 1))
        tiles[:] = False
        return blocks
