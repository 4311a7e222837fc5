"""Draws the scene with OpenCV alone: flat boards, convex pylons, a plane."""

import numpy as np

from airrace.rendering.background import Backdrop, Background
from airrace.rendering.board_painter import Boards
from airrace.rendering.exposure import Exposure, Thing, everything
from airrace.rendering.pylon_painter import Pylons
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
        self._pylons = Pylons(track.pylons(), camera_info)
        self._boards = Boards(track.boards(), camera_info)
        self._gates = len(track.gates)
        self._size = camera_info.width, camera_info.height
        self._canvases = {}  # where exposures are drawn before they are added

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

        The background has no detail that a little motion would blur: unless it
        is more than that, the pictures share one.

        Args:
            poses: pairs of a weight and the pose of the camera; the weights add
                up to 1.
            X_WC: the pose in the middle.
            gate_shifts: as for render().
        """
        behind = [X_WC] if len(poses) <= _SHARING else [pose for _, pose in poses]
        return Exposure(
            [weight for weight, _ in poses],
            [Backdrop(self._background, pose) for pose in behind],
            lambda: [self._things(pose, gate_shifts) for _, pose in poses],
            self._size,
            self._canvases,
        )

    def _things(self, X_WC, gate_shifts) -> list[Thing]:
        """Returns what is seen before the background, in the order to draw it."""
        if X_WC.translation()[2] <= 0:
            return [everything(self._size, EARTH)]
        shifts = np.zeros((self._gates, 3))
        if gate_shifts is not None:
            shifts[:, :2] = gate_shifts
        pylons = self._pylons.look_from(X_WC, np.repeat(shifts, 2, axis=0))
        if pylons.camera_is_inside():
            return [everything(self._size, np.array(PYLON_COLOR) / 2)]
        boards = self._boards.look_from(X_WC, np.repeat(shifts, 4, axis=0))
        # Painter's order. A pylon and its two boards stand in an upright
        # cylinder of the pylon's radius. The cylinders are disjoint and equally
        # thick, so none hides another one whose axis is nearer. Within one, the
        # plane of a board lies between the board's viewer and the pylon. (It cuts
        # the pylon's foot, but only one who looks along it would notice.)
        things = []
        for i in np.argsort(-pylons.distance, kind="stable").tolist():
            if not pylons.in_view[i]:
                continue
            near = [boards.faces_camera[b] for b in (2 * i, 2 * i + 1)]
            things += [boards.thing(2 * i + k) for k in (0, 1) if not near[k]]
            things.append(pylons.thing(i))
            things += [boards.thing(2 * i + k) for k in (0, 1) if near[k]]
        return [thing for thing in things if thing is not None]
