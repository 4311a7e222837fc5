"""Draws marker boards by homography."""

import bisect
import math

import cv2
import numpy as np

from airrace.compiled import compiled
from airrace.rendering.pixels import colors_for
from airrace.rendering.polygons import EXACT, NEAR, clip_near, fill_convex, lay_over
from airrace.rendering.textures import BOARD_BACK, BOARD_TEXELS, WHITE, board_image
from airrace.track import BOARD_SIZE

# Texture sizes, ascending, in steps of about 10 %: texels hardly larger than the
# samples taken of them neither alias nor blur. Sizes of 560 * k / 16 have edges
# between two texels or halfway through one.
_SIZES = sorted({round(BOARD_TEXELS * k / 2**n) for n in range(4, 12) for k in range(9, 17)})
# Maps texture coordinates (texel centres are integers) to the board's plane.
_TEXEL_TO_M = {
    size: np.array([
        [BOARD_SIZE / size, 0, (BOARD_SIZE / size - BOARD_SIZE) / 2],
        [0, -BOARD_SIZE / size, (BOARD_SIZE - BOARD_SIZE / size) / 2],
        [0, 0, 1],
    ])
    for size in _SIZES
}  # fmt: skip
_CORNERS_M = BOARD_SIZE / 2 * np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])
# Boards are supersampled with about that many samples, small ones 4 x 4 fold.
_SAMPLES = 28_000


class Boards:
    """The boards of a track, for a camera."""

    def __init__(self, boards, camera_info):
        """Constructs them.

        Args:
            boards: list of Board.
            camera_info: calibration.
        """
        self.ids = [board.id for board in boards]
        self.size = np.array([camera_info.width, camera_info.height])
        self._K = camera_info.K
        self._p_WM = np.array([board.X_WM.translation() for board in boards])
        self._R_WM = np.array([board.X_WM.rotation().matrix() for board in boards])

    def look_from(self, X_WC, shifts) -> "BoardPainter":
        """Returns what draws the boards as seen from a pose of the camera.

        Args:
            shifts: of the boards from their places in the track, (n, 3) m.
        """
        p_CM_W = self._p_WM + shifts - X_WC.translation()
        return BoardPainter(self, *_look(
            p_CM_W, self._R_WM, self._K @ X_WC.rotation().matrix().T, self.size))


class BoardPainter:
    """Draws any board of a track, seen from one pose of the camera.

    Attributes:
        faces_camera: whether each board does, (n,).
        boxes: the pixels that each can touch, see pixels.py, (n, 4); empty if it
            is out of sight.
    """

    def __init__(self, boards: Boards, faces_camera, H, corners, counts, boxes, scale):
        """Constructs the painter.

        Args:
            H: maps (x, y, 1) of the boards' planes to homogeneous pixels, (n, 3, 3).
            corners: of what is before the camera, (n, 5, 2) px.
            counts: how many of them, (n,).
            scale: least pixels per metre, in any direction, (n,).
        """
        self.faces_camera, self.boxes = faces_camera, boxes
        self._ids, self._H, self._corners, self._counts = boards.ids, H, corners, counts
        self._scale = scale

    def paint(self, i, out, boxes, share=1.0) -> None:
        """Draws the board with index i over what is there, in boxes of a picture.

        Args:
            out: (h, w, channels).
            boxes: see pixels.py, (n, 4); all in that of the board.
            share: of the usual number of samples.
        """
        corners = self._corners[i, :self._counts[i]]
        if not self.faces_camera[i]:
            color = colors_for(out.shape[2], [BOARD_BACK])[0]
            fill_convex(out, corners, color, EXACT, boxes)
        else:
            lay_over(out, self._face(i, share), self.boxes[i, :2], corners, boxes)

    def _face(self, i, share):
        """Returns what is on the front of a board, and white around it, in its box."""
        x0, y0, x1, y1 = self.boxes[i].tolist()
        w, h = x1 - x0, y1 - y0
        s = min(4, max(1, round((share * _SAMPLES / (w * h)) ** 0.5)))
        # The finest texture whose texels are at least as large as a sample.
        wanted = self._scale[i] * s * BOARD_SIZE
        size = _SIZES[max(bisect.bisect(_SIZES, wanted) - 1, 0)]
        # Sample j lies at pixel x0 + (j - (s - 1) / 2) / s.
        shift = (s - 1) / 2
        to_samples = np.array([[s, 0, shift - s * x0], [0, s, shift - s * y0], [0, 0, 1]])
        H = to_samples @ self._H[i] @ _TEXEL_TO_M[size]
        texture = board_image(self._ids[i], size)
        picture = cv2.warpPerspective(texture, H, (s * w, s * h), borderValue=WHITE)
        if s == 1:
            return picture
        return cv2.resize(picture, (w, h), interpolation=cv2.INTER_AREA)


@compiled
def _look(p_CM_W, R_WM, P, size):
    """Returns how boards look; see BoardPainter.

    Args:
        p_CM_W: from the camera to the boards, (n, 3) m.
        R_WM: (n, 3, 3).
        P: K R_CW.
        size: of the picture, [w, h].
    """
    n = len(p_CM_W)
    faces_camera, counts = np.zeros(n, np.bool_), np.zeros(n, np.int64)
    H, corners = np.zeros((n, 3, 3)), np.empty((n, 5, 2))
    boxes, scale = np.zeros((n, 4), np.int64), np.full(n, np.inf)
    corners_h = np.empty((4, 3))
    for i in range(n):
        facing = 0.0
        for j in range(3):
            facing += p_CM_W[i, j] * R_WM[i, j, 2]
        faces_camera[i] = facing < 0.0
        for row in range(3):
            for j in range(3):
                H[i, row, 0] += P[row, j] * R_WM[i, j, 0]
                H[i, row, 1] += P[row, j] * R_WM[i, j, 1]
                H[i, row, 2] += P[row, j] * p_CM_W[i, j]
        for k in range(4):
            x, y = _CORNERS_M[k]
            for row in range(3):
                corners_h[k, row] = H[i, row, 0] * x + H[i, row, 1] * y + H[i, row, 2]
        counts[i] = clip_near(corners_h, corners[i])
        if counts[i] == 0:
            continue
        # Two pixels more hold the smooth edge.
        u0, v0, u1, v1 = np.inf, np.inf, -np.inf, -np.inf
        for k in range(counts[i]):
            u, v = corners[i, k]
            u0, v0, u1, v1 = min(u0, u), min(v0, v), max(u1, u), max(v1, v)
        if not (u0 < size[0] + 2 and v0 < size[1] + 2 and u1 > -3 and v1 > -3):
            continue
        boxes[i, 0], boxes[i, 1] = int(max(math.floor(u0) - 2, 0)), int(max(math.floor(v0) - 2, 0))
        boxes[i, 2] = int(min(math.ceil(u1) + 3, size[0]))
        boxes[i, 3] = int(min(math.ceil(v1) + 3, size[1]))
        for k in range(4):
            if corners_h[k, 2] >= NEAR:
                scale[i] = min(scale[i], _least_scale(H[i], corners_h[k]))
    return faces_camera, H, corners, counts, boxes, scale


@compiled
def _least_scale(H, p):
    """Returns the smaller singular value of the derivative of pixels by metres.

    Args:
        H: see BoardPainter. p: where, homogeneous pixels, (3,).
    """
    u, v = p[0] / p[2], p[1] / p[2]
    a, b = (H[0, 0] - u * H[2, 0]) / p[2], (H[0, 1] - u * H[2, 1]) / p[2]
    c, d = (H[1, 0] - v * H[2, 0]) / p[2], (H[1, 1] - v * H[2, 1]) / p[2]
    half, det = (a * a + b * b + c * c + d * d) / 2, a * d - b * c
    return math.sqrt(max(half - math.sqrt(max(half * half - det * det, 0.0)), 0.0))
