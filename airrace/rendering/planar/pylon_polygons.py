"""Pylons as shaded, banded cones in lists of polygons."""

import math

import numpy as np

from airrace.common.jit import compilable, compiled
from airrace.rendering.planar.polygon_list import add_polygon, end_at_seam, touches, with_grey
from airrace.rendering.planar.polygons import NEAR, bounds, clip_near
from airrace.rendering.scene.pylon_shape import make_pylon_shape
from airrace.rendering.scene.textures import HORIZON, haze
from airrace.track import PYLON_BASE_RADIUS, PYLON_HEIGHT, PYLON_TIP_RADIUS

# Up to which distances (m) a pylon is which polyhedron.
_LIMITS = np.array([15.0, 40.0, np.inf])
_SHAPES = (make_pylon_shape(16, 3), make_pylon_shape(12, 1), make_pylon_shape(6, 0))


def _first(counts) -> np.ndarray:
    """Returns where each part begins, and where the last one ends."""
    return np.cumsum([0, *counts])


# Of all polyhedra, one after the other; see PylonShape.
_VERTICES = np.concatenate([shape.vertices for shape in _SHAPES])
# The first of them are the flank in one colour.
_FACETS = np.concatenate([shape.facets[shape.sides :] for shape in _SHAPES])
_NORMALS = np.concatenate([shape.facet_normals[shape.sides :] for shape in _SHAPES])
_OFFSETS = np.concatenate([shape.facet_offsets[shape.sides :] for shape in _SHAPES])
_SIDES = np.array([shape.sides for shape in _SHAPES])
_COLORS = with_grey(np.concatenate([shape.facet_colors[shape.sides :] for shape in _SHAPES]))
_FIRST_VERTEX = _first([len(shape.vertices) for shape in _SHAPES])
_FIRST_FACET = _first([len(shape.facets) - shape.sides for shape in _SHAPES])
_HORIZON = with_grey([HORIZON])[0]
_EDGE = 2.0  # px, wider than a smooth edge
_RIM = 3.0  # px, around the picture, that what lies beyond cannot touch it
_RIGHT, _LEFT = 1, 3  # edges of a facet, at which others of the same ring begin
# Corners of a frustum that holds a pylon whatever its detail.
_HULL = np.array(
    [
        [1.1 * x * r, 1.1 * y * r, z]
        for x in (-1, 1)
        for y in (-1, 1)
        for r, z in ((PYLON_BASE_RADIUS, 0.0), (PYLON_TIP_RADIUS, PYLON_HEIGHT))
    ]
)
_REACH = np.hypot(_HULL[:, 0], _HULL[:, 1]).max()  # m, from the axis; boards are within it, too
_HULL_EDGES = np.array(
    [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [2, 6], [6, 4], [4, 0], [1, 3], [3, 7], [7, 5], [5, 1]]
)


@compiled
def in_sight(p_CF_W, P, size):
    """Returns which pylons, or boards on them, may be in a picture, (n,).

    Args: as for pylon_boxes().
    """
    w, h = size
    # Inner normals of the planes through the rim, and of the one before the camera.
    normals, reach = np.empty((5, 3)), np.empty(5)
    for j in range(3):
        normals[0, j], normals[1, j] = P[0, j] + _RIM * P[2, j], (w + _RIM) * P[2, j] - P[0, j]
        normals[2, j], normals[3, j] = P[1, j] + _RIM * P[2, j], (h + _RIM) * P[2, j] - P[1, j]
        normals[4, j] = P[2, j]
    for k in range(5):
        reach[k] = _REACH * math.hypot(math.hypot(normals[k, 0], normals[k, 1]), normals[k, 2])
    result = np.empty(len(p_CF_W), np.bool_)
    for i in range(len(p_CF_W)):
        result[i] = True
        for k in range(5):
            foot = 0.0
            for j in range(3):
                foot += normals[k, j] * p_CF_W[i, j]
            if max(foot, foot + normals[k, 2] * PYLON_HEIGHT) < -reach[k]:
                result[i] = False
                break
    return result


@compiled
def pylon_boxes(p_CF_W, P, size, which):
    """Returns the pixels that pylons can touch, see pixels.py, (n, 4); empty if out of sight.

    Args:
        p_CF_W: from the camera to their feet, (n, 3) m.
        P: K R_CW.
        size: of the picture, [w, h].
        which: see in_sight().
    """
    boxes = np.zeros((len(p_CF_W), 4), np.int64)
    hull = np.empty((len(_HULL), 3))
    for i in np.flatnonzero(which):
        nearest = np.inf
        for k in range(len(_HULL)):
            for row in range(3):
                hull[k, row] = 0.0
                for j in range(3):
                    hull[k, row] += P[row, j] * (p_CF_W[i, j] + _HULL[k, j])
            nearest = min(nearest, hull[k, 2])
        u0, v0, u1, v1 = np.inf, np.inf, -np.inf, -np.inf
        for h in hull:
            if h[2] >= NEAR:
                u, v = h[0] / h[2], h[1] / h[2]
                u0, v0, u1, v1 = min(u0, u), min(v0, v), max(u1, u), max(v1, v)
        if nearest < NEAR:
            # Where its edges meet the near plane, the hull ends.
            for k in range(len(_HULL_EDGES)):
                a, b = hull[_HULL_EDGES[k, 0]], hull[_HULL_EDGES[k, 1]]
                if (a[2] >= NEAR) != (b[2] >= NEAR):
                    share = (NEAR - a[2]) / (b[2] - a[2])
                    u = (a[0] + share * (b[0] - a[0])) / NEAR
                    v = (a[1] + share * (b[1] - a[1])) / NEAR
                    u0, v0, u1, v1 = min(u0, u), min(v0, v), max(u1, u), max(v1, v)
        w, h = size
        if u0 < w + _EDGE and v0 < h + _EDGE and u1 > -_EDGE and v1 > -_EDGE:
            boxes[i, 0] = int(max(math.floor(u0 - _EDGE), 0.0))
            boxes[i, 1] = int(max(math.floor(v0 - _EDGE), 0.0))
            boxes[i, 2] = int(min(math.ceil(u1 + _EDGE + 1.0), w))
            boxes[i, 3] = int(min(math.ceil(v1 + _EDGE + 1.0), h))
    return boxes


@compilable
def detail(distance) -> int:
    """Returns as which polyhedron a pylon so far away is drawn."""
    level = 0
    while distance > _LIMITS[level]:
        level += 1
    return level


@compilable
def facet_count(distance) -> int:
    """Returns how many facets a pylon so far away has."""
    level = detail(distance)
    return _FIRST_FACET[level + 1] - _FIRST_FACET[level]


@compiled
def is_inside(p_CF_W) -> bool:
    """Whether the camera is inside the pylon with its foot there; (3,) m."""
    if p_CF_W[2] >= 0.0:
        return False
    for f in range(_FIRST_FACET[1]):
        height = 0.0
        for j in range(3):
            height -= _NORMALS[f, j] * p_CF_W[j]
        if height >= _OFFSETS[f]:
            return False
    return True


@compiled
def add_pylon(polygons, p_CF_W, P, distance, parts, box) -> None:
    """Adds the polygons of a pylon to a list.

    Args:
        polygons: Polygons.
        p_CF_W: from the camera to its foot, (3,) m.
        P: K R_CW.
        distance: of its axis (m).
        parts: of the picture that are looked at, (n, 4).
        box: see pylon_boxes().
    """
    level = detail(distance)
    veil = haze(distance)
    vertices = _VERTICES[_FIRST_VERTEX[level] : _FIRST_VERTEX[level + 1]]
    projected = np.empty((len(vertices), 3))
    for k in range(len(vertices)):
        for row in range(3):
            projected[k, row] = 0.0
            for j in range(3):
                projected[k, row] += P[row, j] * (p_CF_W[j] + vertices[k, j])
    first, sides = _FIRST_FACET[level], _SIDES[level]
    front = np.empty(_FIRST_FACET[level + 1] - first, np.bool_)
    for i in range(len(front)):
        facing = 0.0
        for j in range(3):
            facing -= _NORMALS[first + i, j] * p_CF_W[j]
        front[i] = facing > _OFFSETS[first + i]
    corners_h, corners, color = np.empty((4, 3)), np.empty((5, 2)), np.empty(5)
    for i in np.flatnonzero(front):
        f = first + i
        for k in range(4):
            for j in range(3):
                corners_h[k, j] = projected[_FACETS[f, k], j]
        count = clip_near(corners_h, corners)
        if count > 0 and touches(bounds(corners, count, box), parts):
            for c in range(len(color)):
                color[c] = (1.0 - veil) * _COLORS[f, c] + veil * _HORIZON[c]
            add_polygon(polygons, corners, count, False, color, -1, box)
            if count == 4:
                ring, side = i - i % sides, i % sides
                if front[ring + (side + 1) % sides]:
                    end_at_seam(polygons, _RIGHT)
                if front[ring + (side - 1) % sides]:
                    end_at_seam(polygons, _LEFT)
