"""Draws marker boards by homography."""

import bisect

import cv2
import numpy as np

from airrace.rendering.exposure import Thing
from airrace.rendering.pixels import blend, fill_polygons, part
from airrace.rendering.projection import NEAR, SHIFT, clip_near, to_fixed, to_pixels
from airrace.rendering.textures import BOARD_BACK, BOARD_TEXELS, WHITE, board_image
from airrace.track import BOARD_SIZE

# Texture sizes, ascending, in steps of about 10 %: texels hardly larger than the
# samples taken of them neither alias nor blur. Sizes of 560 * k / 16 have edges
# between two texels or halfway through one.
_SIZES = sorted({round(BOARD_TEXELS * k / 2**n) for n in range(4, 12) for k in range(9, 17)})
_OPAQUE = {size: np.full((size, size), 255, np.uint8) for size in _SIZES}
# Maps texture coordinates (texel centres are integers) to the board's plane.
_TEXEL_TO_M = {
    size: np.array([
        [BOARD_SIZE / size, 0, (BOARD_SIZE / size - BOARD_SIZE) / 2],
        [0, -BOARD_SIZE / size, (BOARD_SIZE - BOARD_SIZE / size) / 2],
        [0, 0, 1],
    ])
    for size in _SIZES
}  # fmt: skip
_CORNERS_M = BOARD_SIZE / 2 * np.array([[-1, 1, 1, -1], [1, 1, -1, -1], [2 / BOARD_SIZE] * 4])
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
        self.size = (camera_info.width, camera_info.height)
        self._K = camera_info.K
        R_WM = np.array([board.X_WM.rotation().matrix() for board in boards])
        self._p_WM = np.array([board.X_WM.translation() for board in boards])
        self._z_W = R_WM[:, :, 2]
        self._xy_W = R_WM[:, :, :2]

    def look_from(self, X_WC, shifts) -> "BoardPainter":
        """Returns what draws the boards as seen from a pose of the camera.

        Args:
            shifts: of the boards from their places in the track, (n, 3) m.
        """
        p_CM_W = self._p_WM + shifts - X_WC.translation()
        faces_camera = np.sum(p_CM_W * self._z_W, axis=1) < 0
        # Maps (x, y, 1) of a board's plane to homogeneous pixels.
        plane_W = np.concatenate([self._xy_W, p_CM_W[:, :, None]], axis=2)
        return BoardPainter(self, faces_camera, self._K @ X_WC.rotation().matrix().T @ plane_W)


class BoardPainter:
    """Draws any board of a track, seen from one pose of the camera.

    Attributes:
        faces_camera: whether each board does, (n,).
    """

    def __init__(self, boards: Boards, faces_camera, H):
        """Args: H: maps (x, y, 1) of the boards' planes to homogeneous pixels, (n, 3, 3)."""
        self.faces_camera = faces_camera.tolist()
        self._ids, self._size, self._H = boards.ids, boards.size, H
        self._corners_h = (H @ _CORNERS_M).transpose(0, 2, 1)
        depth = self._corners_h[:, :, 2]
        in_front = depth >= NEAR
        self._straddles = ~np.all(in_front, axis=1)
        self._corners = self._corners_h[:, :, :2] / np.maximum(depth, NEAR)[:, :, None]
        self._low, self._high = self._rectangle(self._corners, axis=1)
        self._visible = np.all(self._low < self._high, axis=1) | self._straddles
        self._visible &= np.any(in_front, axis=1)

        # Derivatives of pixels by metres at the corners, (n, 4, 2, 2), and
        # their smaller singular values (pixels per metre in the direction that
        # is shortened most).
        J = H[:, None, :2, :2] - self._corners[:, :, :, None] * H[:, None, 2:, :2]
        J /= np.maximum(depth, NEAR)[:, :, None, None]
        det = J[..., 0, 0] * J[..., 1, 1] - J[..., 0, 1] * J[..., 1, 0]
        half = np.sum(J * J, axis=(2, 3)) / 2
        scale = np.sqrt(np.maximum(half - np.sqrt(np.maximum(half**2 - det**2, 0)), 0))
        self._scale = np.min(np.where(in_front, scale, np.inf), axis=1)

    def _rectangle(self, corners, axis):
        """The pixels that polygons can touch, as (low, high) inside the image."""
        # Two pixels more hold the blurred border.
        low = np.floor(np.clip(np.min(corners, axis=axis) - 2, 0, self._size))
        high = np.ceil(np.clip(np.max(corners, axis=axis) + 3, 0, self._size))
        return low.astype(int), high.astype(int)

    def thing(self, i) -> Thing | None:
        """Returns the board with index i, None if it is not in sight."""
        if not self._visible[i]:
            return None
        corners, low, high = self._corners[i], self._low[i], self._high[i]
        if self._straddles[i]:
            corners = to_pixels(clip_near(self._corners_h[i]))
            low, high = self._rectangle(corners, axis=0)
            if not np.all(low < high):
                return None
        box = (*low.tolist(), *high.tolist())
        if self.faces_camera[i]:
            return Thing(box, lambda out, _: self._paint_face(i, corners, box, out))
        back = to_fixed(corners)
        return Thing(box, lambda out, _: fill_polygons(out, [back], [BOARD_BACK], SHIFT))

    def _paint_face(self, i, corners, box, out):
        """Draws the front of the board with index i and these corners over what is in its box."""
        x0, y0, x1, y1 = box
        w, h = x1 - x0, y1 - y0
        # The outline needs no supersampling, what is on the board does.
        alpha = self._warp(None, i, 1, x0, y0, w, h)
        if self._straddles[i]:
            # The homography shows what is behind the camera, too.
            visible = np.zeros((h, w), np.uint8)
            cv2.fillConvexPoly(visible, to_fixed(corners - [x0, y0]), 255, cv2.LINE_8, SHIFT)
            alpha &= visible
        s = min(4, max(1, round((_SAMPLES / (w * h)) ** 0.5)))
        grey = self._warp(self._ids[i], i, s, x0, y0, w, h)
        grey = cv2.multiply(grey, alpha, scale=1 / 255)
        blend(part(out, box), grey, alpha)

    def _warp(self, marker_id, i, s, x0, y0, w, h):
        """Draws a board's face, or its outline, into a rectangle.

        Args:
            marker_id: what is on it; None draws 255 on it and 0 beside it.
            i: index of the board.
            s: samples per pixel in either direction.
            x0, y0, w, h: the rectangle.
        """
        # The finest texture whose texels are at least as large as a sample.
        wanted = self._scale[i] * s * BOARD_SIZE
        size = _SIZES[max(bisect.bisect(_SIZES, wanted) - 1, 0)]
        if marker_id is None:
            texture, beside = _OPAQUE[size], 0
        else:
            texture, beside = board_image(marker_id, size), WHITE
        # Sample j lies at pixel x0 + (j - (s - 1) / 2) / s.
        shift = (s - 1) / 2
        to_samples = np.array([[s, 0, shift - s * x0], [0, s, shift - s * y0], [0, 0, 1]])
        H = to_samples @ self._H[i] @ _TEXEL_TO_M[size]
        picture = cv2.warpPerspective(texture, H, (s * w, s * h), borderValue=beside)
        if s == 1:
            return picture
        return cv2.resize(picture, (w, h), interpolation=cv2.INTER_AREA)
