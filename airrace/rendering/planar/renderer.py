"""Draws the scene without a graphics library: flat boards, convex pylons, a plane."""

import functools
import typing
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from airrace.common.jit import compilable, compiled
from airrace.math.vec3 import dot, from_columns, rotate, rotate_each
from airrace.rendering.images import Box, as_boxes, touches, with_channels
from airrace.rendering.planar.background import Background
from airrace.rendering.planar.marker_face import FACE, marker_crossings, set_face
from airrace.rendering.planar.polygons import (
    EXACT,
    POLYGON,
    WHOLE,
    DisplayList,
    paint,
    set_polygon,
    with_grey,
)
from airrace.rendering.planar.projection import View, bounding_box, clip_near
from airrace.rendering.planar.pylons import MOST_FACETS, add_pylon, is_inside, pylon_box
from airrace.rendering.scene.textures import BOARD_BACK, EARTH, PYLON_COLOR
from airrace.track import BOARD_SIZE

if TYPE_CHECKING:
    from pydrake.math import RigidTransform

    from airrace.track import Track
    from airrace.vehicle.camera_info import CameraInfo

# Corners (x, y, 1) of a board in its plane.
_CORNERS = np.array([[-1.0, 1.0, 0], [1.0, 1.0, 0], [1.0, -1.0, 0], [-1.0, -1.0, 0]])
_CORNERS = _CORNERS * BOARD_SIZE / 2 + [0.0, 0.0, 1.0]
_NUMBERS = np.arange(4)
_BACK, _EARTH, _INSIDE = with_grey([BOARD_BACK, EARTH, np.array(PYLON_COLOR) / 2])  # type: ignore[arg-type]
_NO_CORNERS = np.empty((0, 2))
_SHARING = 4  # exposures, whose blur the background is too soft to show


class Scene(typing.NamedTuple):
    """The pylons and boards of a track.

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


class PlanarRenderer:
    """Draws a track without a graphics library, in about a millisecond.

    Points of the world appear exactly where K maps them: pixel (u, v) of p_C is
    K p_C / z, and integers are pixel centres. Edges of markers lie there to a
    few hundredths of a pixel.
    """

    needs_query_object = False

    def __init__(self, track: "Track", camera_info: "CameraInfo"):
        """Constructs the renderer.

        Args:
            track: a Track.
            camera_info: a CameraInfo; distortion is not drawn.
        """
        self._background = Background(camera_info)
        self._K = np.array(camera_info.K)
        self._picture = Box(0, 0, camera_info.width, camera_info.height)
        feet, boards = np.array(track.pylons(), float), track.boards()
        self._scene = Scene(
            feet,
            np.array([board.X_WM.translation() for board in boards]) - np.repeat(feet, 2, axis=0),
            np.array([board.X_WM.rotation().matrix().T for board in boards]),
            np.array([marker_crossings(board.id) for board in boards]),
        )

    def render(
        self, X_WC: "RigidTransform", out: np.ndarray, gate_shifts: np.ndarray | None = None
    ) -> None:
        """Draws a picture.

        Args:
            X_WC: pose of the camera frame C: z forward, x right, y down.
            out: RGBA or grey levels, see images.py; contiguous; overwritten.
            gate_shifts: of every gate from its place in the track, (n, 2) m, if
                gates move.
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
            poses: pairs of a weight and the pose of the camera; the weights add
                up to 1.
            X_WC: the pose in the middle.
            gate_shifts: as for render().
        """
        scene = self._scene
        if gate_shifts is not None:
            feet = scene.feet.copy()
            feet[:, :2] += np.repeat(gate_shifts, 2, axis=0)
            scene = scene._replace(feet=feet)
        R_WC, p_WC, behind = exposure_poses(poses, X_WC)
        return Exposure(
            functools.partial(self._background.paint, poses=behind),
            lambda parts: _display_list(scene, R_WC, p_WC, self._K, self._picture, parts),
            shares_of(tuple(weight for weight, _ in poses)),
        )


class Exposure:
    """The mean of pictures, any part of which can be drawn by itself.

    A pixel does not depend on what else is drawn, or when.
    """

    def __init__(
        self,
        paint_background: Callable[[np.ndarray, np.ndarray], None],
        display_list: Callable[[np.ndarray], DisplayList],
        shares: np.ndarray,
    ):
        """Args: functions of (out, boxes) and of boxes; shares: see paint()."""
        self._paint_background, self._display_list = paint_background, display_list
        self._shares = shares

    def draw(self, out: np.ndarray, boxes: ArrayLike | None = None) -> None:
        """Draws it.

        Args:
            out: RGBA or grey levels, see images.py; overwritten.
            boxes: the parts to draw, none of which overlap; None: all of it.
        """
        boxes, out = as_boxes(boxes, out), with_channels(out)
        self._paint_background(out, boxes)
        paint(out, boxes, self._display_list(boxes), self._shares)


def exposure_poses(poses: list, X_WC: "RigidTransform") -> tuple[np.ndarray, np.ndarray, list]:
    """Returns R_WC and p_WC of all poses of an exposure, and those of its background.

    Args: see PlanarRenderer.expose().
    """
    behind = [(1.0, X_WC)]
    if len(poses) > _SHARING:
        behind = [(0.5, poses[1][1]), (0.5, poses[-2][1])]
    R_WC = np.array([X_WC.rotation().matrix() for _, X_WC in poses])
    p_WC = np.array([X_WC.translation() for _, X_WC in poses])
    return R_WC, p_WC, behind


@functools.lru_cache(maxsize=16)
def shares_of(weights: Sequence[float]) -> np.ndarray:
    """Returns weights as whole numbers: it is quick to multiply and add bytes by them."""
    return np.diff(np.rint(WHOLE * np.cumsum([0.0, *weights]))).astype(np.uint16)


@compiled
def _display_list(scene, R_WC, p_WC, K, picture, parts):
    """Returns the DisplayList of a scene in exposures from some poses of the camera.

    Args:
        scene: the Scene.
        R_WC, p_WC: the poses, (k, 3, 3) and (k, 3).
        K: calibration. picture: Box of all pixels.
        parts: of the picture, boxes (m, 4); what touches none is left out.
    """
    room = len(p_WC) * (len(scene.feet) * MOST_FACETS + len(scene.p_FM_W))
    polygons, faces = np.empty(room, POLYGON), np.empty(room, FACE)
    starts, n = np.zeros(len(p_WC) + 1, np.int64), 0
    for k in range(len(p_WC)):
        view = View(K @ R_WC[k].T, picture, parts)
        p_CF_W = scene.feet - p_WC[k]
        distance = np.hypot(p_CF_W[:, 0], p_CF_W[:, 1])
        if p_WC[k, 2] <= 0.0:
            set_polygon(polygons[n], _NO_CORNERS, 0, EXACT, _EARTH, picture)
            n += 1
        elif is_inside(p_CF_W[np.argmin(distance)]):
            set_polygon(polygons[n], _NO_CORNERS, 0, EXACT, _INSIDE, picture)
            n += 1
        else:
            for i in np.argsort(-distance, kind="mergesort"):
                n = _add_post(polygons, faces, n, scene, i, p_CF_W[i], view)
        starts[k + 1] = n
    return DisplayList(polygons[:n], faces[:n], starts)


@compilable
def _add_post(
    polygons: np.ndarray,
    faces: np.ndarray,
    n: int,
    scene: Scene,
    i: int,
    p_CF_W: np.ndarray,
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
    box = pylon_box(p_CF_W, view)
    if not touches(box, view.parts):
        return n
    for front in (False, True):
        for b in range(2 * i, 2 * i + 2):
            p_CM_W = p_CF_W + scene.p_FM_W[b]
            x_M, y_M, z_M = scene.R_MW[b]
            if (dot(p_CM_W, z_M) < 0.0) == front:
                P, crossings = view.P, scene.crossings[b]
                H = from_columns(rotate(P, x_M), rotate(P, y_M), rotate(P, p_CM_W))
                n = _add_board(polygons, faces, n, H, crossings, front, view)
        if not front:
            n = add_pylon(polygons, n, p_CF_W, view, box)
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
