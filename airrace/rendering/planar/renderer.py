"""Draws the scene without a graphics library: flat boards, convex pylons, a plane."""

import numpy as np

from airrace.rendering.planar.background import Backdrop, Background
from airrace.rendering.planar.exposure import Exposure
from airrace.rendering.planar.scene_polygons import look
from airrace.rendering.scene.board_face import marker_crossings

_SHARING = 4  # exposures, whose blur the background is too soft to show


class PlanarRenderer:
    """Draws a track without a graphics library, in about a millisecond.

    Points of the world appear exactly where K maps them: pixel (u, v) of p_C is
    K p_C / z, and integers are pixel centres. Edges of markers lie there to a
    few hundredths of a pixel.
    """

    needs_query_object = False

    def __init__(self, track, camera_info):
        """Constructs the renderer.

        Args:
            track: a Track.
            camera_info: a CameraInfo; distortion is not drawn.
        """
        self._background = Background(camera_info)
        self._K = camera_info.K
        self._size = np.array([camera_info.width, camera_info.height])
        self._feet = np.array(track.pylons(), float)
        boards = track.boards()
        # Of the boards, from the feet of their pylons.
        self._p_FM_W = np.array([board.X_WM.translation() for board in boards])
        self._p_FM_W -= np.repeat(self._feet, 2, axis=0)
        self._R_WM = np.array([board.X_WM.rotation().matrix() for board in boards])
        self._crossings = np.array([marker_crossings(board.id) for board in boards])
        self._stay = np.zeros((len(track.gates), 2))

    def render(self, X_WC, out, gate_shifts=None) -> None:
        """Draws a picture.

        Args:
            X_WC: pose of the camera frame C: z forward, x right, y down.
            out: RGBA or grey levels, see pixels.py; contiguous; overwritten.
            gate_shifts: of every gate from its place in the track, (n, 2) m, if
                gates move.
        """
        self.expose([(1.0, X_WC)], X_WC, gate_shifts).draw(out)

    def expose(self, poses, X_WC, gate_shifts=None) -> Exposure:
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
        behind = [(1.0, X_WC)]
        if len(poses) > _SHARING:
            behind = [(0.5, poses[1][1]), (0.5, poses[-2][1])]
        shifts = self._stay if gate_shifts is None else gate_shifts
        return Exposure(
            [weight for weight, _ in poses],
            Backdrop(self._background, behind),
            lambda boxes: look(
                np.array([X_WC.rotation().matrix() for _, X_WC in poses]),
                np.array([X_WC.translation() for _, X_WC in poses]),
                self._K,
                self._size,
                self._feet,
                self._p_FM_W,
                self._R_WM,
                self._crossings,
                np.asarray(shifts, float),
                boxes,
            ),
        )
