"""Pylons and their boards as polygons: pylons are shaded, banded cones with a level of detail for
each distance."""

import math
import typing

import numpy as np

from airrace.common.jit import compilable, compiled
from airrace.math.small_matrices import product
from airrace.math.vec3 import dot
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
from airrace.rendering.scene.pylon_shape import PylonShape, make_pylon_shape
from airrace.rendering.scene.textures import BOARD_BACK, HORIZON, haze
from airrace.track import BOARD_SIZE, PYLON_BASE_RADIUS, PYLON_HEIGHT, Course

# Corners (x, y, 1) of a board in its plane.
_CORNERS = np.array([[-1.0, 1.0, 0], [1.0, 1.0, 0], [1.0, -1.0, 0], [-1.0, -1.0, 0]])
_CORNERS = _CORNERS * BOARD_SIZE / 2 + [0.0, 0.0, 1.0]
_NUMBERS = np.arange(4)
_BACK = with_grey([BOARD_BACK])[0]


class Posts(typing.NamedTuple):
    """The pylons and boards of a course, of which there may be none."""

    feet: np.ndarray  #: of the pylons, two a gate, (2 n, 3) m
    p_FM_W: np.ndarray  #: of the boards, two a pylon, from its foot, (4 n, 3) m
    R_MW: np.ndarray  #: of the boards, (4 n, 3, 3)
    crossings: np.ndarray  #: of their markers, see marker_crossings(), (4 n, 8)


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


def _drawn(sides: int, tip_rings: int) -> PylonShape:
    """Returns a pylon without the facets of its flank in one colour; its colours are (f, 5)."""
    shape = make_pylon_shape(sides, tip_rings)
    return shape._replace(
        facets=shape.facets[sides:],
        facet_normals=shape.facet_normals[sides:],
        facet_offsets=shape.facet_offsets[sides:],
        facet_colors=with_grey(shape.facet_colors[sides:]),
    )


# From near to far, and up to which distances (m).
_DETAILS = (_drawn(16, 3), _drawn(12, 1), _drawn(6, 0))
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
    """Returns what a pylon and its boards can touch; p_CF_W: from camera to foot, (3,) m."""
    hull_h, corners, n = product(_HULL + p_CF_W, view.P.T), np.empty((20, 2)), 0
    for side in _HULL_SIDES:
        n += clip_near(hull_h, side, corners[n:])
    return bounding_box(corners, n, view.picture)


@compiled
def is_inside(p_CF_W: np.ndarray) -> bool:
    """Whether the camera is inside the pylon with its foot there; (3,) m."""
    shape = _DETAILS[0]
    return p_CF_W[2] < 0.0 and np.all(dot(shape.facet_normals.T, -p_CF_W) < shape.facet_offsets)  # type: ignore[return-value]


@compiled
def _add_pylon(polygons, n, p_CF_W, view, box):
    """Adds the polygons of a pylon, see pylon_box(); returns how many there are now."""
    distance = math.hypot(p_CF_W[0], p_CF_W[1])
    shape = _DETAILS[0 if distance <= _LIMITS[0] else 1 if distance <= _LIMITS[1] else 2]
    veil = haze(distance)
    points_h = product(shape.vertices + p_CF_W, view.P.T)
    is_front = dot(shape.facet_normals.T, -p_CF_W) > shape.facet_offsets
    corners = np.empty((5, 2))
    for i in np.flatnonzero(is_front):
        count = clip_near(points_h, shape.facets[i], corners)
        facet_box = bounding_box(corners, count, box)
        if not touches(facet_box, view.parts):
            continue
        color = (1.0 - veil) * shape.facet_colors[i] + veil * _HORIZON
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
            if (dot(p_CF_W + posts.p_FM_W[b], posts.R_MW[b, 2]) < 0.0) == front:
                n = _add_board(polygons, faces, n, posts, b, p_CF_W, view)
        if not front:
            n = _add_pylon(polygons, n, p_CF_W, view, box)
    return n


@compiled
def _add_board(polygons, faces, n, posts, b, p_CF_W, view):
    """Adds board b, its face or its back; returns how many polygons there are now."""
    x_M, y_M, z_M = posts.R_MW[b]
    p_CM_W = p_CF_W + posts.p_FM_W[b]
    # From (x, y, 1) of the board's plane to pixels.
    H = product(view.P, np.column_stack((x_M, y_M, p_CM_W)))
    corners = np.empty((5, 2))
    count = clip_near(product(_CORNERS, H.T), _NUMBERS, corners)
    box = bounding_box(corners, count, view.picture)
    if not touches(box, view.parts):
        return n
    set_polygon(polygons[n], corners, count, EXACT, _BACK, box)
    if dot(p_CM_W, z_M) < 0.0:
        polygons[n].has_face = True
        middle = (box.x0 + min(box.x1 + 1, view.picture.x1)) / 2
        set_face(faces[n], H, posts.crossings[b], box.x0, middle)
    return n + 1
