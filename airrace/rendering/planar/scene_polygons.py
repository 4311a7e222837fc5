"""A track as lists of polygons, as cameras see it."""

import numpy as np

from airrace.common.jit import compilable, compiled
from airrace.rendering.planar.board_polygons import add_board, faces_camera
from airrace.rendering.planar.polygon_list import (
    add_polygon,
    end_thing,
    new_polygons,
    touches,
    with_grey,
)
from airrace.rendering.planar.pylon_polygons import (
    add_pylon,
    facet_count,
    in_sight,
    is_inside,
    pylon_boxes,
)
from airrace.rendering.scene.textures import EARTH, PYLON_COLOR

_EARTH, _DARK = with_grey([EARTH, np.array(PYLON_COLOR) / 2])


@compiled
def look(R_WC, p_WC, K, size, feet, p_FM_W, R_WM, crossings, shifts, parts):
    """Returns the Polygons of a track in pictures from some poses of the camera.

    Args:
        R_WC, p_WC: the poses, (k, 3, 3) and (k, 3).
        K: calibration. size: of the pictures, [w, h].
        feet: of the pylons, two a gate, (2 n, 3), world.
        p_FM_W, R_WM: of the boards, two a pylon, from its foot and in the world, (4 n, 3)
            and (4 n, 3, 3).
        crossings: of the boards, see marker_crossings(), (4 n, 8).
        shifts: of the gates, (n, 2) m.
        parts: of the pictures, see pixels.py, (m, 4); what touches none is left out.
    """
    pictures, pylons = len(p_WC), len(feet)
    P, p_CF_W = np.empty((pictures, 3, 3)), np.empty((pictures, pylons, 3))
    boxes, distance = np.empty((pictures, pylons, 4), np.int64), np.empty((pictures, pylons))
    seen = np.empty((pictures, pylons), np.bool_)
    facets = 1
    for k in range(pictures):
        P[k] = _times_transposed(K, R_WC[k])
        for i in range(pylons):
            for j in range(3):
                p_CF_W[k, i, j] = feet[i, j] + (shifts[i // 2, j] if j < 2 else 0.0) - p_WC[k, j]
            distance[k, i] = np.hypot(p_CF_W[k, i, 0], p_CF_W[k, i, 1])
        seen[k] = in_sight(p_CF_W[k], P[k], size)
        boxes[k] = pylon_boxes(p_CF_W[k], P[k], size, seen[k])
        for i in range(pylons):
            if touches(boxes[k, i], parts):
                facets += facet_count(distance[k, i])
            else:
                boxes[k, i] = 0
    boards = 2 * pictures * pylons
    polygons = new_polygons(pictures, 3 * pictures * pylons + 1, facets + boards, boards)
    everything = np.zeros(4, np.int64)
    everything[2:] = size
    nothing = np.empty((0, 2))
    for k in range(pictures):
        nearest = np.argmin(distance[k])
        if p_WC[k, 2] <= 0.0:
            add_polygon(polygons, nothing, 0, False, _EARTH, -1, everything)
            end_thing(polygons, everything)
        elif is_inside(p_CF_W[k, nearest]):
            add_polygon(polygons, nothing, 0, False, _DARK, -1, everything)
            end_thing(polygons, everything)
        else:
            _add_gates(
                polygons,
                p_CF_W[k],
                distance[k],
                seen[k],
                boxes[k],
                P[k],
                size,
                p_FM_W,
                R_WM,
                crossings,
                parts,
            )
        polygons.pictures[k + 1] = polygons.counts[0]
    return polygons


@compilable
def _add_gates(polygons, p_CF_W, distance, seen, boxes, P, size, p_FM_W, R_WM, crossings, parts):
    """Adds the pylons and boards in some parts of a picture, back to front.

    A pylon and its two boards stand in an upright cylinder of the pylon's radius. The
    cylinders are disjoint and equally thick, so none hides another one whose axis is
    nearer. Within one, the plane of a board lies between the board's viewer and the pylon.
    (It cuts the pylon's foot, but only one who looks along it would notice.)

    Args:
        p_FM_W: of the boards from the pylon's foot, (4 n, 3) m.
        p_CF_W, distance, seen, boxes: of the pylons, see pylon_polygons.py.
        P: K R_CW. Others: see look().
    """
    box, p_CM_W = np.empty(4, np.int64), np.empty(3)
    for i in np.argsort(-distance, kind="mergesort"):
        if not seen[i]:
            continue
        for step in range(3):  # boards that face away, the pylon, boards that face the camera
            if step == 1:
                if boxes[i, 0] < boxes[i, 2]:
                    add_pylon(polygons, p_CF_W[i], P, distance[i], parts, boxes[i])
                    end_thing(polygons, boxes[i])
                continue
            for b in range(2 * i, 2 * i + 2):
                for j in range(3):
                    p_CM_W[j] = p_CF_W[i, j] + p_FM_W[b, j]
                if faces_camera(p_CM_W, R_WM[b]) == (step == 2) and add_board(
                    polygons, p_CM_W, R_WM[b], P, size, crossings[b], parts, box
                ):
                    end_thing(polygons, box)


@compilable
def _times_transposed(A, B):
    """Returns A B^T, both (3, 3)."""
    C = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                C[i, j] += A[i, k] * B[j, k]
    return C
