"""Pylons as polygons: shaded, banded cones with a level of detail for each distance."""

import math
import typing

import numpy as np

from airrace.common.jit import compiled
from airrace.math.vec3 import dot, rotate_each
from airrace.rendering.images import Box, touches
from airrace.rendering.planar.polygons import OVERLAPPING, end_at_seam, set_polygon, with_grey
from airrace.rendering.planar.projection import View, bounding_box, clip_near
from airrace.rendering.scene.pylon_shape import make_pylon_shape
from airrace.rendering.scene.textures import HORIZON, haze
from airrace.track import PYLON_BASE_RADIUS, PYLON_HEIGHT


class Polyhedron(typing.NamedTuple):
    """A pylon as it is drawn, its foot at the origin; see PylonShape.

    Attributes:
        sides: of the cone; so many facets after each other are a ring.
        vertices: (v, 3) m.
        facets: numbers of vertices, (f, 4).
        normals, offsets: outwards, (f, 3), and their product with any point of the facet, (f,).
        colors: (f, 5).
    """

    sides: int
    vertices: np.ndarray
    facets: np.ndarray
    normals: np.ndarray
    offsets: np.ndarray
    colors: np.ndarray


def _polyhedron(sides: int, tip_rings: int) -> Polyhedron:
    shape = make_pylon_shape(sides, tip_rings)
    drawn = slice(sides, None)  # the first facets are the flank in one colour
    return Polyhedron(
        sides,
        shape.vertices,
        shape.facets[drawn],
        shape.facet_normals[drawn],
        shape.facet_offsets[drawn],
        with_grey(shape.facet_colors[drawn]),
    )


# From near to far, and up to which distances (m).
_DETAILS = (_polyhedron(16, 3), _polyhedron(12, 1), _polyhedron(6, 0))
_LIMITS = (15.0, 40.0)
MOST_FACETS = max(len(detail.facets) for detail in _DETAILS)
_HORIZON = with_grey([HORIZON])[0]
_RIGHT, _LEFT = 1, 3  # edges of a facet, at which others of the same ring begin
# Corners of an upright box that holds a pylon and its boards, (8, 3) m, and those of its sides.
_HULL = np.array([[x, y, z] for z in (0, 1) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
_HULL = _HULL * [1.1 * PYLON_BASE_RADIUS, 1.1 * PYLON_BASE_RADIUS, PYLON_HEIGHT]
_HULL_SIDES = np.array([[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])


@compiled
def pylon_box(p_CF_W: np.ndarray, view: View) -> Box:
    """Returns the Box of what a pylon and its boards can touch of a picture.

    Args:
        p_CF_W: from the camera to its foot, (3,) m.
        view: see View.
    """
    hull_h, corners, n = rotate_each(view.P, _HULL + p_CF_W), np.empty((20, 2)), 0
    for side in _HULL_SIDES:
        n += clip_near(hull_h, side, corners[n:])
    return bounding_box(corners, n, view.picture)


@compiled
def is_inside(p_CF_W: np.ndarray) -> bool:
    """Whether the camera is inside the pylon with its foot there; (3,) m."""
    shape = _DETAILS[0]
    return p_CF_W[2] < 0.0 and np.all(dot(shape.normals.T, -p_CF_W) < shape.offsets)  # type: ignore[return-value]


@compiled
def add_pylon(polygons: np.ndarray, n: int, p_CF_W: np.ndarray, view: View, box: Box) -> int:
    """Adds the polygons of a pylon.

    Args:
        polygons: POLYGONs. n: how many there are so far.
        p_CF_W: from the camera to its foot, (3,) m.
        view: see View.
        box: see pylon_box().

    Returns:
        how many polygons there are now.
    """
    distance = math.hypot(p_CF_W[0], p_CF_W[1])
    shape = _DETAILS[0 if distance <= _LIMITS[0] else 1 if distance <= _LIMITS[1] else 2]
    veil = haze(distance)
    points_h = rotate_each(view.P, shape.vertices + p_CF_W)
    is_front = dot(shape.normals.T, -p_CF_W) > shape.offsets
    corners = np.empty((5, 2))
    for i in np.flatnonzero(is_front):
        count = clip_near(points_h, shape.facets[i], corners)
        facet_box = bounding_box(corners, count, box)
        if not touches(facet_box, view.parts):
            continue
        color = (1.0 - veil) * shape.colors[i] + veil * _HORIZON
        set_polygon(polygons[n], corners, count, OVERLAPPING, color, facet_box)
        if count == 4:
            ring, side = i - i % shape.sides, i % shape.sides
            if is_front[ring + (side + 1) % shape.sides]:
                end_at_seam(polygons[n], _RIGHT)
            if is_front[ring + (side - 1) % shape.sides]:
                end_at_seam(polygons[n], _LEFT)
        n += 1
    return n
