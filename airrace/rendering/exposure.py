"""Pictures of things before a background, drawn piece by piece."""

import numpy as np

from airrace.compiled import compiled
from airrace.rendering.pixels import deep, whole

_CELL = 64  # columns of a picture that are worked on together


class Exposure:
    """The mean of pictures, any part of which can be drawn by itself.

    A pixel does not depend on what else is drawn, or when.
    """

    def __init__(self, weights, backdrops, look, canvases):
        """Constructs the exposure.

        Args:
            weights: of the pictures; they add up to 1.
            backdrops: of each picture, or one for all, with paint(out, boxes).
            look: returns for each picture the things in it: an object with ``boxes``,
                the pixels that each can touch, back to front, (n, 4), and with
                paint(k, out, boxes). Called when it is drawn for the first time.
            canvases: dict of what is left over from other exposures.
        """
        self._weights, self._backdrops, self._look = weights, backdrops, look
        self._canvases = canvases
        self._things = None

    def draw(self, out, boxes=None) -> None:
        """Draws it.

        Args:
            out: RGBA or grey levels, see pixels.py; overwritten.
            boxes: the parts to draw, none of which overlap; None: all of it.
        """
        boxes = np.array([whole(out)] if boxes is None else boxes, np.int64).reshape(-1, 4)
        out = deep(out)
        if self._things is None:
            self._things = self._look()
        if len(self._things) == 1:
            self._backdrops[0].paint(out, boxes)
            _paint_all(self._things[0], out, boxes)
            return
        if out.shape not in self._canvases:
            self._canvases[out.shape] = np.empty_like(out), np.empty(out.shape, np.float32)
        canvas, total = self._canvases[out.shape]
        cells = boxes
        if len(self._backdrops) == 1:
            # What all pictures have in common need not be added.
            self._backdrops[0].paint(out, boxes)
            cells = _cells(np.concatenate([t.boxes for t in self._things]), boxes)
        for k, (weight, things) in enumerate(zip(self._weights, self._things)):
            if len(self._backdrops) == 1:
                _copy(out, canvas, cells)
            else:
                self._backdrops[k].paint(canvas, cells)
            _paint_all(things, canvas, cells)
            _add(canvas, total, cells, weight, k == 0)
        _round(total, out, cells)


def _paint_all(things, out, boxes) -> None:
    """Paints what is in boxes of a picture, (h, w, channels)."""
    for k in _meeting(things.boxes, boxes).tolist():
        things.paint(k, out, _common(things.boxes[k], boxes))


@compiled
def _meeting(boxes, others):
    """Returns the indices of the boxes that share pixels with any of the others."""
    found = np.empty(len(boxes), np.int64)
    count = 0
    for k in range(len(boxes)):
        a0, b0, a1, b1 = boxes[k]
        for c0, d0, c1, d1 in others:
            if a0 < c1 and c0 < a1 and b0 < d1 and d0 < b1:
                found[count] = k
                count += 1
                break
    return found[:count]


@compiled
def _common(box, others):
    """Returns what a box shares with each of the others, as far as it is not empty."""
    found = np.empty((len(others), 4), np.int64)
    count = 0
    for other in others:
        found[count, 0], found[count, 1] = max(box[0], other[0]), max(box[1], other[1])
        found[count, 2], found[count, 3] = min(box[2], other[2]), min(box[3], other[3])
        if found[count, 0] < found[count, 2] and found[count, 1] < found[count, 3]:
            count += 1
    return found[:count]


@compiled
def _cells(things, boxes):
    """Returns those parts of boxes that hold all things in them, (n, 4).

    What lies between far things is left out: there is one cell for each column of
    pixels, _CELL wide, from the highest to the lowest thing in it. Neighbours are
    joined if that makes them little larger.
    """
    columns = (boxes[:, 2].max() + _CELL - 1) // _CELL
    low = np.full(columns, np.iinfo(np.int64).max)
    high = np.zeros(columns, np.int64)
    for x0, y0, x1, y1 in things:
        if x0 < x1 and y0 < y1:
            for k in range(x0 // _CELL, min((x1 - 1) // _CELL + 1, columns)):
                low[k], high[k] = min(low[k], y0), max(high[k], y1)
    cells = np.empty((len(boxes) * columns, 4), np.int64)
    count = 0
    for x0, y0, x1, y1 in boxes:
        first = count
        for k in range(x0 // _CELL, (x1 - 1) // _CELL + 1):
            top, bottom = max(y0, low[k]), min(y1, high[k])
            if top < bottom:
                if count > first and cells[count - 1, 2] == max(x0, k * _CELL):
                    last = cells[count - 1]
                    y2, y3 = min(last[1], top), max(last[3], bottom)
                    wide, right = last[2] - last[0], min(x1, (k + 1) * _CELL)
                    parts = wide * (last[3] - last[1]) + (right - last[2]) * (bottom - top)
                    if (right - last[0]) * (y3 - y2) <= 1.5 * parts:
                        last[1], last[2], last[3] = y2, right, y3
                        continue
                cells[count, 0], cells[count, 2] = max(x0, k * _CELL), min(x1, (k + 1) * _CELL)
                cells[count, 1], cells[count, 3] = top, bottom
                count += 1
    return cells[:count]


@compiled
def _copy(source, target, boxes):
    """Copies boxes of a picture."""
    channels = source.shape[2]
    a, b = source.reshape(len(source), -1), target.reshape(len(target), -1)
    for x0, y0, x1, y1 in boxes:
        for y in range(y0, y1):
            b[y, x0 * channels:x1 * channels] = a[y, x0 * channels:x1 * channels]


@compiled
def _add(picture, total, boxes, weight, first):
    """Adds a weighted picture to a total in boxes; the first one starts it."""
    weight, channels = np.float32(weight), picture.shape[2]
    a, b = picture.reshape(len(picture), -1), total.reshape(len(total), -1)
    for x0, y0, x1, y1 in boxes:
        for y in range(y0, y1):
            levels = a[y, x0 * channels:x1 * channels]
            sums = b[y, x0 * channels:x1 * channels]
            if first:
                sums[:] = 0.0
            for k in range(len(levels)):
                sums[k] += weight * np.float32(levels[k])


@compiled
def _round(total, out, boxes):
    """Makes grey levels of the total, in boxes."""
    channels = out.shape[2]
    a, b = total.reshape(len(total), -1), out.reshape(len(out), -1)
    for x0, y0, x1, y1 in boxes:
        for y in range(y0, y1):
            sums = a[y, x0 * channels:x1 * channels]
            levels = b[y, x0 * channels:x1 * channels]
            for k in range(len(levels)):
                levels[k] = np.uint8(np.int32(sums[k] + np.float32(0.5)))
