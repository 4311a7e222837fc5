"""Draws square gates and halls without a graphics library: flat faces, back to front."""

import functools
import math
import typing
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from airrace.common.jit import compilable, compiled
from airrace.math.vec3 import dot, rotate_each
from airrace.rendering.images import Box, touches
from airrace.rendering.planar.background import Background
from airrace.rendering.planar.marker_face import FACE
from airrace.rendering.planar.polygons import (
    EXACT,
    POLYGON,
    DisplayList,
    end_at_seam,
    set_polygon,
    with_grey,
)
from airrace.rendering.planar.projection import View, bounding_box, clip_near
from airrace.rendering.planar.renderer import Exposure, exposure_poses, shares_of
from airrace.rendering.scene.solids import Faces, solids_of

if TYPE_CHECKING:
    from pydrake.math import RigidTransform

    from airrace.track.square_track import SquareTrack
    from airrace.vehicle.camera_info import CameraInfo

_NUMBERS = np.arange(4)


class Solids(typing.NamedTuple):
    """All solids of a scene, the first of which are behind all others.

    Attributes:
        behind: how many these are; they are drawn in their order.
        corners, normals, colors, mitred: of all faces, (f, 4, 3) m, (f, 3), (f, 5) and (f,).
        starts: the first face of each solid, and the end of the last, (k + 1,).
        low, high: of boxes around the solids along the world's axes, (k, 3) m.
    """

    behind: int
    corners: np.ndarray
    normals: np.ndarray
    colors: np.ndarray
    mitred: np.ndarray
    starts: np.ndarray
    low: np.ndarray
    high: np.ndarray


def make_solids(behind: list[Faces], others: list[Faces]) -> Solids:
    """Args: see solids_of()."""
    every = behind + others
    return Solids(
        len(behind),
        np.concatenate([faces.corners for faces in every]),
        np.concatenate([faces.normals for faces in every]),
        with_grey(np.concatenate([faces.colors for faces in every])),
        np.concatenate([faces.mitred for faces in every]),
        np.cumsum([0, *(len(faces.corners) for faces in every)]),
        np.array([faces.corners.min((0, 1)) for faces in every]),
        np.array([faces.corners.max((0, 1)) for faces in every]),
    )


class SolidsRenderer:
    """Draws a SquareTrack, in about a millisecond; see PlanarRenderer for what is exact.

    Within a solid, no face that is seen hides another one; solids hide each other by their
    distances. Both hold for frames and columns that keep apart.
    """

    needs_query_object = False

    def __init__(self, track: "SquareTrack", camera_info: "CameraInfo"):
        """Args: track: that is drawn. camera_info: a CameraInfo; distortion is not drawn."""
        self._K = np.array(camera_info.K)
        self._picture = Box(0, 0, camera_info.width, camera_info.height)
        self._solids = make_solids(*solids_of(track))
        self._background = Background(camera_info) if track.hall() is None else None

    def render(self, X_WC: "RigidTransform", out: np.ndarray) -> None:
        """Draws a picture.

        Args:
            X_WC: pose of the camera frame C: z forward, x right, y down.
            out: RGBA or grey levels, see images.py; contiguous; overwritten.
        """
        self.expose([(1.0, X_WC)], X_WC).draw(out)

    def expose(self, poses: list, X_WC: "RigidTransform") -> Exposure:
        """Returns the mean of several pictures; see PlanarRenderer.expose()."""
        R_WC, p_WC, behind = exposure_poses(poses, X_WC)
        paint_background = _fill_black
        if self._background is not None:
            paint_background = functools.partial(self._background.paint, poses=behind)
        return Exposure(
            paint_background,
            lambda parts: _display_list(self._solids, R_WC, p_WC, self._K, self._picture, parts),
            shares_of(tuple(weight for weight, _ in poses)),
        )


def _fill_black(out: np.ndarray, boxes: ArrayLike) -> None:
    for x0, y0, x1, y1 in np.asarray(boxes).tolist():
        out[y0:y1, x0:x1] = 0
        out[y0:y1, x0:x1, 3:] = 255


@compiled
def _display_list(solids, R_WC, p_WC, K, picture, parts):
    """Returns the DisplayList of Solids in exposures from some poses; see renderer.py."""
    polygons = np.empty(len(p_WC) * len(solids.corners), POLYGON)
    starts, n = np.zeros(len(p_WC) + 1, np.int64), 0
    count = len(solids.starts) - 1
    for k in range(len(p_WC)):
        view = View(K @ R_WC[k].T, picture, parts)
        for i in range(solids.behind):
            n = _add_solid(polygons, n, solids, i, p_WC[k], view)
        distances = np.empty(count - solids.behind)
        for i in range(len(distances)):
            distances[i] = _distance(solids, solids.behind + i, p_WC[k])
        for i in np.argsort(-distances, kind="mergesort"):
            n = _add_solid(polygons, n, solids, solids.behind + i, p_WC[k], view)
        starts[k + 1] = n
    return DisplayList(polygons[:n], np.empty(n, FACE), starts)


@compilable
def _distance(solids, i, p):
    """Returns the distance of a point from the box around solid i (m)."""
    total = 0.0
    for axis in range(3):
        off = max(solids.low[i, axis] - p[axis], p[axis] - solids.high[i, axis], 0.0)
        total += off * off
    return math.sqrt(total)


@compilable
def _add_solid(polygons, n, solids, i, p_WC, view):
    """Adds the faces of solid i that are seen from p_WC; returns how many polygons there are."""
    corners = np.empty((5, 2))
    for f in range(solids.starts[i], solids.starts[i + 1]):
        if dot(solids.normals[f], p_WC - solids.corners[f, 0]) <= 0.0:
            continue
        count = clip_near(rotate_each(view.P, solids.corners[f] - p_WC), _NUMBERS, corners)
        box = bounding_box(corners, count, view.picture)
        if count >= 3 and touches(box, view.parts):
            set_polygon(polygons[n], corners, count, EXACT, solids.colors[f], box)
            if solids.mitred[f]:
                end_at_seam(polygons[n], 0)
                end_at_seam(polygons[n], 2)
            n += 1
    return n
