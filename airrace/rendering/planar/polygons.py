"""Convex polygons with smooth edges: lists of them, and how they are painted, back to front.

Along an edge, (a, b) is the unit normal outwards and a x + b y + c the distance from it (px); a
colour fades out over a pixel of such distances (an edge function: Pineda, SIGGRAPH 1988).
"""

import math
import typing

import numpy as np
from numpy.typing import ArrayLike

from airrace.common.jit import compilable, compiled
from airrace.rendering.images import Box, colors_for, intersection, is_empty
from airrace.rendering.planar.marker_face import face_levels

MOST_SIDES = 5  # four, and one where the near plane cuts a corner off
WHOLE = 256  # what the shares of exposures add up to
_TILE_W, _TILE_H = 512, 64  # what is averaged at once stays in the processor's caches
_SEAM = 1e-6  # px
_GREY = 4  # where a colour has its grey level, after RGBA


# Up to which distance from an edge, outwards (px), a colour fades out; a pixel before, it is
# full. Facets of one body overlap by as much as they fade, or what is behind would shine
# through the seams.
EXACT, OVERLAPPING = 0.5, 1.0

POLYGON = np.dtype(
    [
        ("box", np.int64, 4),  # the pixels that it can touch
        ("sides", np.int64),
        ("end", np.float64),  # EXACT or OVERLAPPING
        ("a", np.float64, MOST_SIDES),
        ("b", np.float64, MOST_SIDES),
        ("c", np.float64, MOST_SIDES),
        # On row y, the fade is from column x_full + slope y to column x_end + slope y.
        ("slope", np.float64, MOST_SIDES),
        ("x_full", np.float64, MOST_SIDES),
        ("x_end", np.float64, MOST_SIDES),
        ("color", np.float64, 5),  # RGBA and the grey level
        ("has_face", np.bool_),  # of a board, in place of the colour
    ],
    align=True,
)


class DisplayList(typing.NamedTuple):
    """The polygons of one or more exposures, back to front."""

    polygons: np.ndarray  #: of the type POLYGON, (n,)
    faces: np.ndarray  #: of those that have one, FACE, (n,)
    starts: np.ndarray  #: the first polygon of each exposure, and the end of the last, (k + 1,)


class Span(typing.NamedTuple):
    """What a polygon touches of a row: columns start to stop - 1; full_start to full_stop - 1 are
    full of it."""

    start: int
    full_start: int
    full_stop: int
    stop: int


def with_grey(colors: ArrayLike) -> np.ndarray:
    """Returns colours, RGB (n, 3), as polygons have them, (n, 5)."""
    return np.column_stack([colors_for(4, colors), colors_for(1, colors)])


@compilable
def set_polygon(
    polygon: np.record, corners: np.ndarray, n: int, end: float, color: np.ndarray, box: Box
) -> None:
    """Fills a POLYGON; corners that coincide have no edge between them.

    Args:
        corners: (n or more, 2) px, either way round. n: how many; none fill the box.
        end: EXACT or OVERLAPPING. color: (5,). box: what the polygon can touch.
    """
    polygon.box[0], polygon.box[1], polygon.box[2], polygon.box[3] = box.x0, box.y0, box.x1, box.y1
    polygon.end, polygon.has_face = end, False
    polygon.color[:] = color
    area = 0.0
    for i in range(n):
        j = (i + 1) % n
        area += corners[i, 0] * corners[j, 1] - corners[i, 1] * corners[j, 0]
    sign = 1.0 if area > 0.0 else -1.0
    side = 0
    for i in range(n):
        x, y = corners[i, 0], corners[i, 1]
        dx, dy = corners[(i + 1) % n, 0] - x, corners[(i + 1) % n, 1] - y
        length = math.sqrt(dx * dx + dy * dy)
        if length > 1e-6:
            a, b = sign * dy / length, -sign * dx / length
            c = -a * x - b * y
            polygon.a[side], polygon.b[side], polygon.c[side] = a, b, c
            if abs(a) > 1e-9:
                polygon.slope[side] = -b / a
                polygon.x_full[side] = (end - 1.0 - c) / a
                polygon.x_end[side] = (end - c) / a
            side += 1
    polygon.sides = side


@compilable
def end_at_seam(polygon: np.record, edge: int) -> None:
    """Ends a polygon of four sides sharply at the edge of an index, where another one begins.

    A pixel there is painted by the polygon that its centre is in. Fading out over each other
    is for edges that something else is behind; inside of a body it would take half as much
    time again, and nobody sees it.
    """
    if polygon.sides == 4:
        a, c = polygon.a[edge], polygon.c[edge]
        # A little more than nothing: rounding must leave no gap.
        end = (_SEAM - c) / a if abs(a) > 1e-9 else polygon.x_full[edge]
        polygon.x_full[edge] = polygon.x_end[edge] = end


@compilable
def row_span(polygon: np.record, y: int, x0: int, x1: int) -> Span:
    """Returns what a polygon touches of columns x0 to x1 - 1 of row y."""
    nothing = Span(x0, x0, x0, x0)
    low, high, full_low, full_high = float(x0), x1 - 1.0, float(x0), x1 - 1.0
    for i in range(polygon.sides):
        a, along = polygon.a[i], polygon.slope[i] * y
        if a > 1e-9:
            high = min(high, polygon.x_end[i] + along)
            full_high = min(full_high, polygon.x_full[i] + along)
        elif a < -1e-9:
            low = max(low, polygon.x_end[i] + along)
            full_low = max(full_low, polygon.x_full[i] + along)
        else:
            distance = polygon.b[i] * y + polygon.c[i]
            if distance > polygon.end:
                return nothing
            if distance > polygon.end - 1.0:
                full_high = full_low - 1.0
    if not low <= high:
        return nothing
    start, stop = int(math.ceil(low)), int(math.floor(high)) + 1
    full_start = int(math.ceil(max(full_low, low)))
    full_stop = int(math.floor(min(full_high, high))) + 1
    if full_start >= full_stop:
        return Span(start, stop, stop, stop)
    return Span(start, full_start, full_stop, stop)


@compilable
def coverage(polygon: np.record, x: float, y: int) -> float:
    """Returns how much of a pixel a polygon covers, 0 to 1."""
    if polygon.end == EXACT and polygon.sides == 4:
        # What opposite edges leave of the pixel in either direction: so a polygon that is
        # smaller than a pixel is as faint as it should be.
        share = 1.0
        for i in range(2):
            left = -1.0
            for k in (i, i + 2):
                distance = polygon.a[k] * x + polygon.b[k] * y + polygon.c[k]
                left += min(max(polygon.end - distance, 0.0), 1.0)
            share *= max(left, 0.0)
        return share
    farthest = polygon.end - 1.0
    for k in range(polygon.sides):
        farthest = max(farthest, polygon.a[k] * x + (polygon.b[k] * y + polygon.c[k]))
    return max(polygon.end - farthest, 0.0)


@compiled
def paint(
    image: np.ndarray, boxes: np.ndarray, display_list: DisplayList, shares: np.ndarray
) -> None:
    """Paints the mean of exposures over a background.

    Args:
        image: the background, (h, w, channels), uint8; painted over.
        boxes: the parts to paint, (n, 4).
        shares: of the exposures, uint16; they add up to WHOLE.
    """
    scratch = np.empty((5, image.shape[1]), np.float32)
    layer, total = np.empty_like(image), np.empty(image.shape, np.uint16)
    for x0, y0, x1, y1 in boxes:
        if len(shares) == 1:
            _paint_exposure(image, Box(x0, y0, x1, y1), display_list, 0, scratch)
            continue
        for y in range(y0, y1, _TILE_H):
            for x in range(x0, x1, _TILE_W):
                tile = Box(x, y, min(x + _TILE_W, x1), min(y + _TILE_H, y1))
                _average(image, tile, display_list, shares, layer, total, scratch)


@compilable
def _average(image, tile, display_list, shares, layer, total, scratch):
    """Paints the mean of exposures into a tile; layer, total: scratch of the image's shape."""
    # Only where some exposure has a polygon: the rest need not be averaged.
    x0, y0, x1, y1 = tile.x1, tile.y1, tile.x0, tile.y0
    for polygon in display_list.polygons:
        part = intersection(polygon.box, tile)
        if not is_empty(part):
            x0, y0, x1, y1 = min(x0, part.x0), min(y0, part.y0), max(x1, part.x1), max(y1, part.y1)
    box = Box(x0, y0, x1, y1)
    if is_empty(box):
        return
    h, channels = len(image), image.shape[2]
    first, last = box.x0 * channels, box.x1 * channels
    behind, levels, sums = image.reshape(h, -1), layer.reshape(h, -1), total.reshape(h, -1)
    for k in range(len(shares)):
        for y in range(box.y0, box.y1):
            below, level = behind[y, first:last], levels[y, first:last]
            for j in range(len(level)):
                level[j] = below[j]
        _paint_exposure(layer, box, display_list, k, scratch)
        for y in range(box.y0, box.y1):
            level, so_far = levels[y, first:last], sums[y, first:last]
            for j in range(len(level)):
                before = so_far[j] if k > 0 else np.uint16(WHOLE // 2)
                so_far[j] = np.uint16(before + np.uint16(shares[k] * np.uint16(level[j])))
    for y in range(box.y0, box.y1):
        mean, so_far = behind[y, first:last], sums[y, first:last]
        for j in range(len(mean)):
            mean[j] = np.uint8(so_far[j] // np.uint16(WHOLE))


@compilable
def _paint_exposure(image, box, display_list, k, scratch):
    """Paints a box of exposure k over what is there."""
    for i in range(display_list.starts[k], display_list.starts[k + 1]):
        polygon = display_list.polygons[i]
        part = intersection(polygon.box, box)
        if not is_empty(part):
            _paint_polygon(image, part, polygon, display_list.faces[i], scratch)


@compiled
def _paint_polygon(image, box, polygon, face, scratch):
    """Paints a polygon in its colour, or with the face of a board, within a box.

    A face leaves the opacity as it is.
    """
    channels, has_face = image.shape[2], polygon.has_face
    shown = min(channels, 3) if has_face else channels
    color, levels = polygon.color[_GREY:] if channels == 1 else polygon.color[:channels], scratch[0]
    for y in range(box.y0, box.y1):
        row, span = image[y], row_span(polygon, y, box.x0, box.x1)
        if span.start == span.stop:
            continue
        full = row[span.full_start : span.full_stop]
        if has_face:
            levels = face_levels(face, span.start, span.stop, y, scratch)
        first = span.full_start - span.start
        for c in range(shown):
            if has_face:
                for k in range(len(full)):
                    full[k, c] = np.uint8(np.int32(levels[first + k] + np.float32(0.5)))
            else:
                flat = np.uint8(color[c] + 0.5)
                for k in range(len(full)):
                    full[k, c] = flat
        for start, stop in ((span.start, span.full_start), (span.full_stop, span.stop)):
            for x in range(start, stop):
                share = coverage(polygon, x, y)
                for c in range(shown):
                    level, behind = levels[x - span.start] if has_face else color[c], row[x, c]
                    row[x, c] = np.uint8(np.int32(behind + share * (level - float(behind)) + 0.5))
