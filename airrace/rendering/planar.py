"""Draws the scene without a graphics library: flat boards, convex pylons, a plane."""

import numpy as np

from airrace.compiled import compiled
from airrace.rendering.background import Backdrop, Background
from airrace.rendering.board_painter import Boards
from airrace.rendering.exposure import Exposure
from airrace.rendering.pixels import colors_for, part
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
            lambda: [self._things(pose, gate_shifts, 1.0 / len(poses)) for _, pose in poses],
            self._canvases,
        )

    def _things(self, X_WC, gate_shifts, share):
        """Returns what is seen before the background; see Exposure."""
        if X_WC.translation()[2] <= 0:
            return _Everything(self._size, EARTH)
        shifts = np.zeros((self._gates, 3))
        if gate_shifts is not None:
            shifts[:, :2] = gate_shifts
        pylons = self._pylons.look_from(X_WC, np.repeat(shifts, 2, axis=0))
        if pylons.camera_is_inside():
            return _Everything(self._size, np.array(PYLON_COLOR) / 2)
        return _Scene(pylons, self._boards.look_from(X_WC, np.repeat(shifts, 4, axis=0)), share)


class _Scene:
    """All pylons and boards in sight, back to front; see Exposure."""

    def __init__(self, pylons, boards, share):
        """Args: share: of the usual number of samples that boards are drawn with."""
        self._pylons, self._boards, self._share = pylons, boards, share
        # Painter's order. A pylon and its two boards stand in an upright
        # cylinder of the pylon's radius. The cylinders are disjoint and equally
        # thick, so none hides another one whose axis is nearer. Within one, the
        # plane of a board lies between the board's viewer and the pylon. (It cuts
        # the pylon's foot, but only one who looks along it would notice.)
        far_first = np.argsort(-pylons.distance, kind="stable")
        self._order, self.boxes = _in_sight(
            far_first, pylons.boxes, boards.boxes, boards.faces_camera)

    def paint(self, k, out, boxes) -> None:
        i = self._order[k]
        if i < 0:
            self._pylons.paint(-1 - i, out, boxes)
        else:
            self._boards.paint(i, out, boxes, self._share)


@compiled
def _in_sight(far_first, pylons, boards, faces_camera):
    """Returns what to draw in order, a board's index or -1 - a pylon's, and their boxes."""
    order = np.empty(3 * len(pylons), np.int64)
    boxes = np.empty((3 * len(pylons), 4), np.int64)
    count = 0
    for i in far_first:
        for step in range(3):  # boards that face away, the pylon, boards that face the camera
            for b in range(2 * i, 2 * i + (1 if step == 1 else 2)):
                box = pylons[i] if step == 1 else boards[b]
                drawn = step == 1 or faces_camera[b] == (step == 2)
                if drawn and box[0] < box[2] and box[1] < box[3]:
                    order[count] = -1 - i if step == 1 else b
                    boxes[count] = box
                    count += 1
    return order[:count], boxes[:count]


class _Everything:
    """One colour everywhere; see Exposure."""

    def __init__(self, size, color):
        self.boxes = np.array([[0, 0, *size]])
        self._color = color

    def paint(self, k, out, boxes) -> None:
        color = np.uint8(np.round(colors_for(out.shape[2], [self._color])[0]))
        for box in boxes:
            part(out, box)[:] = color
