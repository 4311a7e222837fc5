"""Pylons and their boards as polygons: pylons are shaded, banded cones with a level of detail for
each distance."""

import math
import typing

import numpy as np

from airrace.common.jit import compilable, compiled
from airrace.math.vec3 import dot, from_columns, rotate, rotate_each
from airrace.rendering.images import Box, touches
from airrace.rendering.planar.marker_face import marker_crossings, set_face
from airrace.rendering.planar.polygons import (
    EXACT,
    OVERLAPPING,
    end_at_seam,
    set_polygon,
    with_grey,
)
from airrace.rendering.planar.projection import View, bounding_box, clip_near
from airrace.rendering.scene.pylon_shape import make_pylon_shape
from airrace.rendering.scene.textures import BOARD_BACK, HORIZON, haze
from airrace.track import BOARD_SIZE, PYLON_BASE_RADIUS, PYLON_HEIGHT, Course

# Corners (x, y, 1) of a board in its plane.
_CORNERS = np.array([[-1.0, 1.0, 0], [1.0, 1.0, 0], [1.0, -1.0, 0], [-1.0, -1.0, 0]])
_CORNERS = _CORNERS * BOARD_SIZE / 2 + [0.0, 0.0, 1.0]
_NUMBERS = np.arange(4)
_BACK = with_grey([BOARD_BACK])[0]


class Posts(typing.NamedTuple):
    """The pylons and boards of a course, of which there may be none.

    Attributes:
        feet: of the pylons, two a gate, (2 n, 3) m.
        p_FM_W: of the boards, two a pylon, from its foot, (4 n, 3) m.
        R_MW: of the boards, (4 n, 3, 3).
        crossings: of their markers, see marker_crossings(), (4 n, 8).
    """

    feet: np.ndarray
    p_FM_W: np.ndarray
    R_MW: np.ndarray
    crossings: np.ndarray


def make_posts(track: Course) -> Posts:
    """Returns the pylons and boards of a course."""
    feet, boards = track.pylons(), track.boards()
    p_WM = np.array([board.X_WM.translation() for board in boards]).reshape(-1, 3)
    return Posts(
        feet,
        p_WM - np.repeat(feet, 2, axis=0),
        np.array([board.X_WM.rotation().matrix().T for board in boards]).reshape(-1, 3, 3),
        np.array([marker_crossings(board.id) for board in boards]).reshape(-1, 8),
    )


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
def _add_pylon(polygons: np.ndarray, n: int, p_CF_W: np.ndarray, view: View, box: Box) -> int:
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


@compilable
def add_post(
    polygons: np.ndarray,
    faces: np.ndarray,
    n: int,
    posts: Posts,
    i: int,
    p_WC: np.ndarray,
    view: View,
) -> int:
    """Adds pylon i and its boards, back to front (the painter's algorithm).

    A pylon and its two boards stand in an upright cylinder of the pylon's radius. The
    cylinders are disjoint and equally thick, so none hides another one whose axis is
    nearer. Within one, the plane of a board lies between the board's viewer and the pylon.
    (It cuts the pylon's foot, but only one who looks along it would notice.)

    Returns:
        how many polygons there are now.
    """
    p_CF_W = posts.feet[i] - p_WC
    box = pylon_box(p_CF_W, view)
    if not touches(box, view.parts):
        return n
    for front in (False, True):
        for b in range(2 * i, 2 * i + 2):
            p_CM_W = p_CF_W + posts.p_FM_W[b]
            x_M, y_M, z_M = posts.R_MW[b]
            if (dot(p_CM_W, z_M) < 0.0) == front:
                P, crossings = view.P, posts.crossings[b]
                H = from_columns(rotate(P, x_M), rotate(P, y_M), rotate(P, p_CM_W))
                n = _add_board(polygons, faces, n, H, crossings, front, view)
        if not front:
            n = _add_pylon(polygons, n, p_CF_W, view, box)
    return n


@compiled
def _add_board(
    polygons: np.ndarray,
    faces: np.ndarray,
    n: int,
    H: np.ndarray,
    crossings: np.ndarray,
    front: bool,
    view: View,
) -> int:
    """Adds a board.

    Args:
        polygons, faces: POLYGONs and FACEs. n: how many there are so far.
        H: homography from (x, y, 1) of its plane to pixels, (3, 3).
        crossings: see marker_crossings().
        front: whether its face is seen, or its back.
        view: see View.

    Returns:
        how many polygons there are now.
    """
    corners = np.empty((5, 2))
    count = clip_near(rotate_each(H, _CORNERS), _NUMBERS, corners)
    box = bounding_box(corners, count, view.picture)
    if not touches(box, view.parts):
        return n
    set_polygon(polygons[n], corners, count, EXACT, _BACK, box)
    if front:
        polygons[n].has_face = True
        middle = (box.x0 + min(box.x1 + 1, view.picture.x1)) / 2
        set_face(faces[n], H, crossings, box.x0, middle)
    return n + 1
