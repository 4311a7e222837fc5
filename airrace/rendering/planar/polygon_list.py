"""Lists of polygons, back to front."""

import typing

import numpy as np

from airrace.common.jit import compilable, compiled
from airrace.rendering.imaging.pixels import colors_for
from airrace.rendering.planar.polygons import EXACT, OVERLAPPING, bounds, edge_lines

_SEAM = 1e-6  # px
GREY = 4  # where colours have their grey level, after RGBA


class Polygons(typing.NamedTuple):
    """Polygons of one or more pictures.

    Things are polygons that follow each other; there are as many as counts[0], in
    pictures[k] to pictures[k + 1] - 1 those of picture k.

    Attributes:
        counts: of things, polygons and faces that are in use, (3,).
        pictures: (k + 1,).
        things: first polygon of each, and of what follows them, (t + 1,).
        thing_boxes: the pixels that each can touch, see pixels.py, (t, 4).
        boxes: of the polygons, likewise, (n, 4).
        lines, sides: along their edges, (n, 5, 6), and how many, (n,); see edge_lines().
        exact: whether they fade as EXACT says, else as OVERLAPPING, (n,).
        colors: RGBA and grey levels, (n, 5).
        faces: index of the board's face to be seen, or -1 for the colour, (n,).
        to_modules: of the faces, see modules_from_pixels(), (f, 3, 3).
        crossings: see marker_crossings(), (f, 8).
        anchors: see face_levels(), (f, 2).
        samples: see find_samples(), (f, 2).
    """

    counts: np.ndarray
    pictures: np.ndarray
    things: np.ndarray
    thing_boxes: np.ndarray
    boxes: np.ndarray
    lines: np.ndarray
    sides: np.ndarray
    exact: np.ndarray
    colors: np.ndarray
    faces: np.ndarray
    to_modules: np.ndarray
    crossings: np.ndarray
    anchors: np.ndarray
    samples: np.ndarray


def with_grey(colors) -> np.ndarray:
    """Returns colours, RGB (n, 3), as Polygons have them, (n, 5)."""
    return np.column_stack([colors_for(4, colors), colors_for(1, colors)])


@compiled
def new_polygons(pictures, things, polygons, faces):
    """Returns Polygons that have room for so many, without any yet."""
    return Polygons(
        np.zeros(3, np.int64),
        np.zeros(pictures + 1, np.int64),
        np.zeros(things + 1, np.int64),
        np.empty((things, 4), np.int64),
        np.empty((polygons, 4), np.int64),
        np.empty((polygons, 5, 6)),
        np.empty(polygons, np.int64),
        np.empty(polygons, np.bool_),
        np.empty((polygons, 5)),
        np.empty(polygons, np.int64),
        np.empty((faces, 3, 3)),
        np.empty((faces, 8), np.int32),
        np.empty((faces, 2)),
        np.empty((faces, 2), np.int64),
    )


@compilable
def add_polygon(polygons, corners, n, exact, color, face, box) -> None:
    """Adds a polygon to the last thing.

    Args:
        corners: (n or more, 2) px, n <= 5. n: how many there are; none for all of the box.
        exact, color, face: see Polygons.
        box: that it is in, (4,).
    """
    i = polygons.counts[1]
    polygons.counts[1] = i + 1
    low, high = EXACT if exact else OVERLAPPING
    polygons.sides[i] = edge_lines(corners, n, low, high, polygons.lines, i)
    x0, y0, x1, y1 = bounds(corners, n, box) if n > 0 else (box[0], box[1], box[2], box[3])
    polygons.boxes[i, 0], polygons.boxes[i, 1] = x0, y0
    polygons.boxes[i, 2], polygons.boxes[i, 3] = x1, y1
    polygons.exact[i], polygons.faces[i] = exact, face
    for c in range(len(color)):
        polygons.colors[i, c] = color[c]


@compilable
def touches(box, parts) -> bool:
    """Whether a box shares a pixel with any of some others, (n, 4)."""
    for i in range(len(parts)):
        if max(box[0], parts[i, 0]) < min(box[2], parts[i, 2]) and max(box[1], parts[i, 1]) < min(
            box[3], parts[i, 3]
        ):
            return True
    return False


@compilable
def end_at_seam(polygons, edge) -> None:
    """Ends the last polygon sharply at one of its edges, where another one begins.

    A pixel is painted by the one that its centre is in. Fading out over each other is for
    edges that something else is behind; here it takes half as much time again, and
    nobody sees it.

    Args:
        polygons: the last must have four sides, or nothing happens.
        edge: its index.
    """
    i = polygons.counts[1] - 1
    if polygons.sides[i] == 4:
        a, c = polygons.lines[i, edge, 0], polygons.lines[i, edge, 2]
        # A little more than nothing: rounding must leave no gap.
        end = (_SEAM - c) / a if abs(a) > 1e-9 else polygons.lines[i, edge, 4]
        polygons.lines[i, edge, 4] = polygons.lines[i, edge, 5] = end


@compilable
def end_thing(polygons, box) -> None:
    """Ends a thing; the next polygon begins another one."""
    t = polygons.counts[0]
    polygons.thing_boxes[t] = box
    polygons.things[t + 1] = polygons.counts[1]
    polygons.counts[0] = t + 1
