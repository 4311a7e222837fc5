"""Paints lists of polygons."""

import numpy as np

from airrace.common.jit import compilable, compiled
from airrace.rendering.planar.polygon_list import GREY
from airrace.rendering.planar.polygons import EXACT, OVERLAPPING, cover, spans
from airrace.rendering.scene.board_face import face_levels

WHOLE = 256  # what the shares of pictures in their mean add up to
_TILE_W, _TILE_H = 512, 64  # what is averaged at once stays in the processor's caches
_LANES = 32  # pixels that a processor works on together, at most
_HALF = np.float32(0.5)


@compiled
def paint(out, boxes, polygons, shares) -> None:
    """Paints the mean of pictures over a background.

    Args:
        out: the background, (h, w, channels), uint8; painted over.
        boxes: the parts to paint, see pixels.py, (n, 4).
        polygons: of the pictures.
        shares: of the pictures, uint16; they add up to WHOLE.
    """
    channels = out.shape[2]
    flat = out.reshape(len(out), -1)
    if len(shares) == 1:
        scratch = np.empty((5, out.shape[1] + _LANES), np.float32)
        for box in boxes:
            _paint_picture(flat, channels, 0, 0, box, polygons, 0, scratch)
        return
    canvas = np.empty((_TILE_H, _TILE_W * channels), np.uint8)
    total = np.empty((_TILE_H, _TILE_W * channels), np.uint16)
    scratch = np.empty((5, _TILE_W + _LANES), np.float32)
    tile = np.empty(4, np.int64)
    for x0, y0, x1, y1 in boxes:
        for y in range(y0, y1, _TILE_H):
            for x in range(x0, x1, _TILE_W):
                tile[0], tile[1] = x, y
                tile[2], tile[3] = min(x + _TILE_W, x1), min(y + _TILE_H, y1)
                # What all pictures have in common need not be added.
                if _shrink(tile, polygons):
                    _average(flat, channels, tile, polygons, shares, canvas, total, scratch)


@compilable
def _shrink(tile, polygons) -> bool:
    """Shrinks a box to what things can touch of it; returns whether they do."""
    x0, y0, x1, y1 = tile[2], tile[3], tile[0], tile[1]
    boxes, part = polygons.thing_boxes, np.empty(4, np.int64)
    for t in range(polygons.counts[0]):
        if _cut(boxes, t, tile, part):
            x0, y0, x1, y1 = min(x0, part[0]), min(y0, part[1]), max(x1, part[2]), max(y1, part[3])
    tile[0], tile[1], tile[2], tile[3] = x0, y0, x1, y1
    return x0 < x1


@compilable
def _average(flat, channels, box, polygons, shares, canvas, total, scratch) -> None:
    """Paints the mean of pictures into a box, no larger than a tile; see paint()."""
    x0, y0, x1, y1 = box
    first, last = x0 * channels, x1 * channels
    for k in range(len(shares)):
        share = shares[k]
        for i in range(y1 - y0):
            behind, levels = flat[y0 + i, first:last], canvas[i]
            for j in range(len(behind)):
                levels[j] = behind[j]
        _paint_picture(canvas, channels, x0, y0, box, polygons, k, scratch)
        for i in range(y1 - y0):
            levels, sums = canvas[i, : last - first], total[i]
            for j in range(len(levels)):
                before = sums[j] if k > 0 else np.uint16(WHOLE // 2)
                sums[j] = np.uint16(before + np.uint16(share * np.uint16(levels[j])))
    for i in range(y1 - y0):
        levels, sums = flat[y0 + i, first:last], total[i]
        for j in range(len(levels)):
            levels[j] = np.uint8(sums[j] // np.uint16(WHOLE))


@compilable
def _paint_picture(out, channels, x, y, box, polygons, k, scratch) -> None:
    """Paints a box of picture k over what is there.

    Args:
        out: (h, w * channels). x, y: its first pixel.
    """
    things, thing_boxes, boxes = polygons.things, polygons.thing_boxes, polygons.boxes
    lines, sides, exact = polygons.lines, polygons.sides, polygons.exact
    colors, faces = polygons.colors, polygons.faces
    first_color, shown = (GREY, 1) if channels == 1 else (0, channels)
    part = np.empty(4, np.int64)
    for t in range(polygons.pictures[k], polygons.pictures[k + 1]):
        if not _cut(thing_boxes, t, box, part):
            continue
        for i in range(things[t], things[t + 1]):
            if not _cut(boxes, i, box, part):
                continue
            face = faces[i]
            if face < 0:
                _fill(
                    out,
                    channels,
                    x,
                    y,
                    part,
                    lines[i, : sides[i]],
                    exact[i],
                    colors[i, first_color : first_color + shown],
                )
            else:
                _fill_face(
                    out,
                    channels,
                    x,
                    y,
                    part,
                    lines[i, : sides[i]],
                    scratch,
                    polygons.to_modules[face],
                    polygons.crossings[face],
                    polygons.anchors[face],
                    polygons.samples[face],
                )


@compilable
def _cut(boxes, i, box, part) -> bool:
    """Finds what box i shares with another one; returns whether it is anything."""
    part[0], part[1] = max(boxes[i, 0], box[0]), max(boxes[i, 1], box[1])
    part[2], part[3] = min(boxes[i, 2], box[2]), min(boxes[i, 3], box[3])
    return part[0] < part[2] and part[1] < part[3]


@compiled
def _fill(out, channels, x_out, y_out, box, lines, exact, color) -> None:
    """Fills a polygon with a colour, (channels,), within a box; see _paint_picture()."""
    low, high = EXACT if exact else OVERLAPPING
    x0, y0, x1, y1 = box
    grey = np.uint8(color[0] + 0.5)
    for y in range(y0, y1):
        first, last, filled, until = spans(lines, y, low, high, x0, x1)
        if first > last:
            continue
        v = np.uint64(y - y_out)
        if channels == 1:
            for x in range(np.uint64(filled - x_out), np.uint64(max(until + 1, filled) - x_out)):
                out[v, x] = grey
        else:
            for x in range(filled, until + 1):
                for c in range(channels):
                    out[v, np.uint64((x - x_out) * channels + c)] = np.uint8(color[c] + 0.5)
        if first == filled and until == last:
            continue
        for start, stop in ((first, filled), (until + 1, last + 1)):
            for x in range(start, stop):
                if exact:
                    share = cover(lines, x, y, low, high)
                else:
                    farthest = 0.0
                    for j in range(len(lines)):
                        # The brackets are the same for all pixels of a row.
                        farthest = max(farthest, lines[j, 0] * x + (lines[j, 1] * y + lines[j, 2]))
                    share = max(1.0 - farthest, 0.0)
                for c in range(channels):
                    at = np.uint64((x - x_out) * channels + c)
                    level = float(out[v, at])
                    out[v, at] = np.uint8(np.int32(level + share * (color[c] - level) + 0.5))


@compiled
def _fill_face(
    out, channels, x_out, y_out, box, lines, scratch, to_modules, crossings, anchor, samples
) -> None:
    """Fills a polygon with the face of a board, within a box; see _paint_picture()."""
    low, high = EXACT
    x0, y0, x1, y1 = box
    shown = min(channels, 3)  # opacity stays
    for y in range(y0, y1):
        first, last, filled, until = spans(lines, y, low, high, x0, x1)
        if first > last:
            continue
        some = -(-(last + 1 - first) // _LANES) * _LANES
        levels = face_levels(
            scratch, some, to_modules, crossings, anchor, first - int(anchor[0]), y, samples
        )
        v = np.uint64(y - y_out)
        if channels == 1:
            at, begin = np.uint64(filled - x_out), np.uint64(filled - first)
            for k in range(np.uint64(max(until + 1 - filled, 0))):
                out[v, at + k] = np.uint8(np.int32(levels[begin + k] + _HALF))
        else:
            for x in range(filled, until + 1):
                for c in range(shown):
                    out[v, np.uint64((x - x_out) * channels + c)] = np.uint8(
                        levels[x - first] + 0.5
                    )
        for start, stop in ((first, filled), (until + 1, last + 1)):
            for x in range(start, stop):
                share, level = cover(lines, x, y, low, high), levels[x - first]
                for c in range(shown):
                    at = np.uint64((x - x_out) * channels + c)
                    behind = out[v, at]
                    out[v, at] = np.uint8(behind + share * (level - behind) + 0.5)
