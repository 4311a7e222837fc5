"""Draws the scene without a graphics library: flat boards, convex pylons, solids, a plane."""

import dataclasses as dc
import functools
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from airrace.common.jit import compiled
from airrace.math.vec3 import dot
from airrace.rendering.images import Box, as_boxes, with_channels
from airrace.rendering.planar.background import Background
from airrace.rendering.planar.marker_face import FACE
from airrace.rendering.planar.polygons import (
    EXACT,
    POLYGON,
    WHOLE,
    DisplayList,
    paint,
    set_polygon,
    with_grey,
)
from airrace.rendering.planar.projection import View
from airrace.rendering.planar.pylons import MOST_FACETS, add_post, is_inside, make_posts
from airrace.rendering.planar.solids import add_solid, make_solids
from airrace.rendering.scene.textures import EARTH, PYLON_COLOR

if TYPE_CHECKING:
    from pydrake.math import RigidTransform

    from airrace.track import Course
    from airrace.vehicle.camera_info import CameraInfo

_EARTH, _INSIDE = with_grey([EARTH, np.array(PYLON_COLOR) / 2])  # type: ignore[arg-type]
_NO_CORNERS = np.empty((0, 2))
_SHARING = 4  # exposures, whose blur the background is too soft to show


class PlanarRenderer:
    """Draws a course without a graphics library, in about a millisecond.

    Points of the world appear exactly where K maps them: pixel (u, v) of p_C is
    K p_C / z, and integers are pixel centres. Edges of markers lie there to a
    few hundredths of a pixel.
    """

    needs_query_object = False

    def __init__(self, track: "Course", camera_info: "CameraInfo"):
        """Args: track: that is drawn. camera_info: a CameraInfo; distortion is not drawn."""
        self._background = Background(camera_info) if track.hall() is None else None
        self._K = np.array(camera_info.K)
        self._picture = Box(0, 0, camera_info.width, camera_info.height)
        self._posts, self._solids = make_posts(track), make_solids(track)

    def render(
        self, X_WC: "RigidTransform", out: np.ndarray, gate_shifts: np.ndarray | None = None
    ) -> None:
        """Draws a picture.

        Args:
            X_WC: pose of the camera frame C: z forward, x right, y down.
            out: RGBA or grey levels, see images.py; contiguous; overwritten.
            gate_shifts: of every gate of pylons from its place, (n, 2) m, if gates move.
        """
        self.expose([(1.0, X_WC)], X_WC, gate_shifts).draw(out)

    def expose(
        self, poses: list, X_WC: "RigidTransform", gate_shifts: np.ndarray | None = None
    ) -> "Exposure":
        """Returns the mean of several pictures from nearly the same place.

        The background has no detail that a little motion would blur: that of the pose in
        the middle stands for all, or if they are many, those of two on either side, which
        lie about as far apart as the mean of all is wide.

        Args:
            poses: pairs of a weight and X_WC; the weights add up to 1.
            X_WC: the pose in the middle.
            gate_shifts: as for render().
        """
        posts, solids = self._posts, self._solids
        if gate_shifts is not None:
            feet = posts.feet.copy()
            feet[:, :2] += np.repeat(gate_shifts, 2, axis=0)
            posts = posts._replace(feet=feet)
        behind, paint_background = [(1.0, X_WC)], _fill_black
        if len(poses) > _SHARING:
            behind = [(0.5, poses[1][1]), (0.5, poses[-2][1])]
        if self._background is not None:
            paint_background = functools.partial(self._background.paint, poses=behind)
        R_WC = np.array([X_WC.rotation().matrix() for _, X_WC in poses])
        p_WC = np.array([X_WC.translation() for _, X_WC in poses])
        return Exposure(
            paint_background,
            lambda parts: _display_list(posts, solids, R_WC, p_WC, self._K, self._picture, parts),
            _shares_of(tuple(weight for weight, _ in poses)),
        )


def _fill_black(out: np.ndarray, boxes: ArrayLike) -> None:
    """Paints the background in a hall."""
    for x0, y0, x1, y1 in np.asarray(boxes).tolist():
        out[y0:y1, x0:x1] = 0
        out[y0:y1, x0:x1, 3:] = 255


@dc.dataclass(frozen=True)
class Exposure:
    """The mean of pictures, any part of which can be drawn by itself.

    A pixel does not depend on what else is drawn, or when.
    """

    paint_background: Callable[[np.ndarray, np.ndarray], None]  #: of a picture and boxes
    display_list: Callable[[np.ndarray], DisplayList]  #: of boxes
    shares: np.ndarray  #: see paint()

    def draw(self, out: np.ndarray, boxes: ArrayLike | None = None) -> None:
        """Draws it into RGBA or grey levels; boxes: parts that do not overlap; None: all of it."""
        boxes, out = as_boxes(boxes, out), with_channels(out)
        self.paint_background(out, boxes)
        paint(out, boxes, self.display_list(boxes), self.shares)


@functools.lru_cache(maxsize=16)
def _shares_of(weights: Sequence[float]) -> np.ndarray:
    """Returns weights as whole numbers: it is quick to multiply and add bytes by them."""
    return np.diff(np.rint(WHOLE * np.cumsum([0.0, *weights]))).astype(np.uint16)


@compiled
def _display_list(posts, solids, R_WC, p_WC, K, picture, parts):
    """Returns the DisplayList of Posts and Solids in exposures from some poses of the camera.

    What is nearer hides the rest.

    Args:
        R_WC, p_WC: the poses, (k, 3, 3) and (k, 3). K: calibration. picture: Box of all pixels.
        parts: of the picture, boxes (m, 4); what touches none is left out.
    """
    most = len(posts.feet) * MOST_FACETS + len(posts.p_FM_W) + len(solids.corners)
    polygons, faces = np.empty(len(p_WC) * most, POLYGON), np.empty(len(p_WC) * most, FACE)
    starts, n = np.zeros(len(p_WC) + 1, np.int64), 0
    count = len(posts.feet)
    distances = np.empty(count + len(solids.low) - solids.behind)
    for k in range(len(p_WC)):
        view = View(K @ R_WC[k].T, picture, parts)
        for i in range(count):
            distances[i] = np.hypot(posts.feet[i, 0] - p_WC[k, 0], posts.feet[i, 1] - p_WC[k, 1])
        for i in range(solids.behind, len(solids.low)):  # from the boxes around them
            off = np.maximum(np.maximum(solids.low[i] - p_WC[k], p_WC[k] - solids.high[i]), 0.0)
            distances[count + i - solids.behind] = math.sqrt(dot(off, off))
        if p_WC[k, 2] <= 0.0:
            set_polygon(polygons[n], _NO_CORNERS, 0, EXACT, _EARTH, picture)
            n += 1
        elif count and is_inside(posts.feet[np.argmin(distances[:count])] - p_WC[k]):
            set_polygon(polygons[n], _NO_CORNERS, 0, EXACT, _INSIDE, picture)
            n += 1
        else:
            for i in range(solids.behind):
                n = add_solid(polygons, n, solids, i, p_WC[k], view)
            for i in np.argsort(-distances, kind="mergesort"):
                if i < count:
                    n = add_post(polygons, faces, n, posts, i, p_WC[k], view)
                else:
                    n = add_solid(polygons, n, solids, solids.behind + i - count, p_WC[k], view)
        starts[k + 1] = n
    return DisplayList(polygons[:n], faces[:n], starts)
