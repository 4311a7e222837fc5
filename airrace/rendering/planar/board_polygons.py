"""Marker boards in lists of polygons."""

import math

import numpy as np

from airrace.common.jit import compiled
from airrace.rendering.planar.polygon_list import add_polygon, touches, with_grey
from airrace.rendering.planar.polygons import clip_near
from airrace.rendering.scene.board_face import find_samples, modules_from_pixels
from airrace.rendering.scene.textures import BOARD_BACK
from airrace.track import BOARD_SIZE

_CORNERS_M = BOARD_SIZE / 2 * np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])
_BACK = with_grey([BOARD_BACK])[0]


@compiled
def faces_camera(p_CM_W, R_WM) -> bool:
    """Whether a board faces the camera; see add_board()."""
    return p_CM_W[0] * R_WM[0, 2] + p_CM_W[1] * R_WM[1, 2] + p_CM_W[2] * R_WM[2, 2] < 0.0


@compiled
def add_board(polygons, p_CM_W, R_WM, P, size, crossings, parts, box) -> bool:
    """Adds the polygon of a board to a list.

    Args:
        polygons: Polygons.
        p_CM_W: from the camera to its middle, (3,) m.
        R_WM: (3, 3).
        P: K R_CW.
        size: of the picture, [w, h].
        crossings: see marker_crossings().
        parts: of the picture that are looked at, (n, 4).
        box: where to put the pixels that it can touch, (4,).

    Returns:
        whether it is in sight there.
    """
    H, corners_h, corners = np.zeros((3, 3)), np.empty((4, 3)), np.empty((5, 2))
    for row in range(3):
        for j in range(3):
            H[row, 0] += P[row, j] * R_WM[j, 0]
            H[row, 1] += P[row, j] * R_WM[j, 1]
            H[row, 2] += P[row, j] * p_CM_W[j]
    for k in range(4):
        x, y = _CORNERS_M[k, 0], _CORNERS_M[k, 1]
        for row in range(3):
            corners_h[k, row] = H[row, 0] * x + H[row, 1] * y + H[row, 2]
    count = clip_near(corners_h, corners)
    # Two pixels more hold the smooth edge.
    u0, v0, u1, v1 = np.inf, np.inf, -np.inf, -np.inf
    for k in range(count):
        u, v = corners[k, 0], corners[k, 1]
        u0, v0, u1, v1 = min(u0, u), min(v0, v), max(u1, u), max(v1, v)
    if not (u0 < size[0] + 2 and v0 < size[1] + 2 and u1 > -3 and v1 > -3):
        return False
    box[0], box[1] = int(max(math.floor(u0) - 2, 0)), int(max(math.floor(v0) - 2, 0))
    box[2], box[3] = int(min(math.ceil(u1) + 3, size[0])), int(min(math.ceil(v1) + 3, size[1]))
    if not touches(box, parts):
        return False
    face = -1
    if faces_camera(p_CM_W, R_WM):
        face = polygons.counts[2]
        polygons.counts[2] = face + 1
        x, y = H[0, 2] / H[2, 2], H[1, 2] / H[2, 2]
        modules_from_pixels(H, polygons.to_modules[face])
        find_samples(polygons.to_modules[face], x, y, polygons.samples[face])
        polygons.crossings[face] = crossings
        polygons.anchors[face, 0], polygons.anchors[face, 1] = box[0], (box[0] + box[2]) / 2
    add_polygon(polygons, corners, count, True, _BACK, face, box)
    return True
