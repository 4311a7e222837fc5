"""Pictures of things before a background, drawn piece by piece."""

import dataclasses as dc
import typing

import numpy as np

from airrace.rendering.motion_blur import add_picture
from airrace.rendering.pixels import fill, part, whole

_CELL = 64  # columns of a picture that are worked on together


@dc.dataclass(frozen=True)
class Thing:
    """Something to draw.

    Attributes:
        box: the pixels that it can touch, see pixels.py.
        paint: draws it over a picture, at least in a box; called with both.
    """

    box: tuple
    paint: typing.Callable


def everything(size, color) -> Thing:
    """Returns a thing that fills pictures of a size, (w, h), with a colour."""
    return Thing((0, 0, *size), lambda out, box: fill(out, color))


class Exposure:
    """The mean of pictures, any part of which can be drawn by itself.

    A pixel does not depend on what else is drawn, or when.
    """

    def __init__(self, weights, backdrops, look, size, canvases):
        """Constructs the exposure.

        Args:
            weights: of the pictures; they add up to 1.
            backdrops: of each picture, or one for all, with paint(out, box).
            look: returns a list of Things, back to front, for each picture;
                called when it is drawn for the first time.
            size: (w, h).
            canvases: dict of what is left over from other exposures.
        """
        self._weights, self._backdrops, self._look = weights, backdrops, look
        self._size, self._canvases = size, canvases
        self._things = self._cells = None

    def draw(self, out, boxes=None) -> None:
        """Draws it.

        Args:
            out: RGBA or grey levels, see pixels.py; overwritten.
            boxes: the parts to draw, none of which overlap; None: all of it.
        """
        boxes = [whole(out)] if boxes is None else boxes
        if self._things is None:
            self._things = self._look()
            self._cells = self._crowded_cells()
        if out.shape not in self._canvases:
            self._canvases[out.shape] = np.empty_like(out)
        canvas = self._canvases[out.shape]
        cells = boxes
        if len(self._backdrops) == 1:
            # What all pictures have in common need not be added.
            for box in boxes:
                self._backdrops[0].paint(out, box)
            cells = []
            for box in boxes:
                # A small box is not worth being split.
                split = [box] if box[2] - box[0] <= 5 * _CELL else self._cells
                cells += [cell for cell in (common(cell, box) for cell in split) if cell]
        total = 0.0
        for k, (weight, things) in enumerate(zip(self._weights, self._things)):
            for cell in cells:
                self._backdrops[k % len(self._backdrops)].paint(canvas, cell)
            # What is drawn is drawn as a whole, so that it looks the same in any box.
            for thing in things:
                wanted = [box for box in boxes if common(thing.box, box)]
                if wanted:
                    thing.paint(canvas, _around(wanted))
            for cell in cells:
                if k == 0:
                    part(out, cell)[:] = part(canvas, cell)
                else:
                    add_picture(part(out, cell), total, part(canvas, cell), weight)
            total += weight

    def _crowded_cells(self) -> list:
        """Returns boxes that together hold all things, of one column of cells each."""
        width = self._size[0]
        spans = {}
        for x0, y0, x1, y1 in {thing.box for things in self._things for thing in things}:
            for column in range(x0 // _CELL, -(-x1 // _CELL)):
                low, high = spans.get(column, (y0, y1))
                spans[column] = min(low, y0), max(high, y1)
        return [
            (column * _CELL, low, min((column + 1) * _CELL, width), high)
            for column, (low, high) in spans.items()
        ]


def _around(boxes) -> tuple:
    """Returns the box around some boxes."""
    x0, y0, x1, y1 = zip(*boxes)
    return min(x0), min(y0), max(x1), max(y1)


def common(box, other) -> tuple | None:
    """Returns the box that two boxes share, None if it is empty."""
    a0, b0, a1, b1 = box
    c0, d0, c1, d1 = other
    if a0 >= c1 or c0 >= a1 or b0 >= d1 or d0 >= b1:
        return None
    return max(a0, c0), max(b0, d0), min(a1, c1), min(b1, d1)
