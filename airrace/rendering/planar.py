"""Draws the scene with OpenCV alone: flat boards, convex pylons, a plane."""

import numpy as np

from airrace.rendering.background import Background
from airrace.rendering.board_painter import BoardPainter
from airrace.rendering.motion_blur import mean_picture
from airrace.rendering.pixels import fill
from airrace.rendering.pylon_painter import PylonPainter
from airrace.rendering.textures import EARTH, PYLON_COLOR

_SHARING = 4  # exposures, whose blur the background is too soft to show


class PlanarRenderer:
    """Draws a track without a graphics library, in a few milliseconds.

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
        self._pylons = PylonPainter(track.pylons(), camera_info)
        self._boards = BoardPainter(track.boards(), camera_info)

    def render(self, X_WC, out, gate_shifts=None) -> None:
        """Draws a picture.

        Args:
            X_WC: pose of the camera frame C: z forward, x right, y down.
            out: RGBA or grey levels, see pixels.py; contiguous; overwritten.
            gate_shifts: of every gate from its place in the track, (n, 2) m, if
                gates move; then they must be given for every picture.
        """
        self._move(gate_shifts)
        self._background.paint(X_WC, out)
        self._paint_things(X_WC, out)

    def expose(self, poses, X_WC, out, gate_shifts=None) -> None:
        """Draws the mean of several pictures from nearly the same place.

        The background has no detail that a little motion would blur: unless it
        is more than that, the pictures share one.

        Args:
            poses: pairs of a weight and the pose of the camera; the weights add
                up to 1.
            X_WC: the pose in the middle.
            out, gate_shifts: as for render().
        """
        self._move(gate_shifts)
        if len(poses) > _SHARING:
            mean_picture(self.render, poses, out)
            return
        background = np.empty_like(out)
        self._background.paint(X_WC, background)

        def render(X_WC, out):
            np.copyto(out, background)
            self._paint_things(X_WC, out)

        mean_picture(render, poses, out)

    def _paint_things(self, X_WC, out):
        """Draws pylons and boards over the background."""
        if X_WC.translation()[2] <= 0:
            fill(out, EARTH)
            return
        self._pylons.look_from(X_WC)
        if self._pylons.camera_is_inside():
            fill(out, np.array(PYLON_COLOR) / 2)
            return
        self._boards.look_from(X_WC)
        # Painter's order. A pylon and its two boards stand in an upright
        # cylinder of the pylon's radius. The cylinders are disjoint and equally
        # thick, so none hides another one whose axis is nearer. Within one, the
        # plane of a board lies between the board's viewer and the pylon. (It cuts
        # the pylon's foot, but only one who looks along it would notice.)
        for i in np.argsort(-self._pylons.distance, kind="stable"):
            if not self._pylons.in_view[i]:
                continue
            boards = (2 * i, 2 * i + 1)
            for b in boards:
                if not self._boards.faces_camera[b]:
                    self._boards.paint(b, out)
            self._pylons.paint(i, out)
            for b in boards:
                if self._boards.faces_camera[b]:
                    self._boards.paint(b, out)

    def _move(self, gate_shifts):
        """Puts the gates where the next pictures show them; None: where they are."""
        if gate_shifts is None:
            return
        shifts = np.column_stack([gate_shifts, np.zeros(len(gate_shifts))])
        self._pylons.move(np.repeat(shifts, 2, axis=0))
        self._boards.move(np.repeat(shifts, 4, axis=0))
