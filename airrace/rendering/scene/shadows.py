"""Shadows on the grass, as pictures that lie on it."""

import cv2
import numpy as np

from airrace.rendering.scene.pylon_shape import make_pylon_shape
from airrace.rendering.scene.textures import SUN_W
from airrace.track import BOARD_SIZE

# The sun stands still, and gates do not turn when they move, so shadows are drawn
# once. Shadow maps of a render engine would have to cover the whole track: they
# are coarse, darken what is lit, and double the time of a picture.
_TEXELS = 256  # a side
_DARKNESS = 100  # opacity, of 255
_COLOR = (10, 20, 12)  # RGB
_HEIGHT = 0.03  # above the grass, or the two would flicker (m)
_MARGIN = 0.5  # of the picture around the shadow (m)
_BLUR = 0.08  # the sun is no point: standard deviation of the edge (m)
_CORNERS_M = BOARD_SIZE / 2 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])


def pylon_shadow(foot: np.ndarray, boards: list) -> tuple[np.ndarray, np.ndarray]:
    """Returns the shadow of a pylon with its foot at (3,) m, and of its boards.

    Returns:
        vertices of a rectangle just above the ground, (4, 3), relative to the
        foot, counter-clockwise from the lower left corner of its picture; and
        the picture, RGBA, (n, n, 4), uint8: transparent where the sun shines.
    """
    solids = [make_pylon_shape(24, 3).vertices]
    solids += [(board.X_WM @ _CORNERS_M.T).T - foot for board in boards]
    outlines = [cv2.convexHull(np.float32(cast(points)))[:, 0] for points in solids]  # type: ignore[call-overload]
    low = np.min([outline.min(axis=0) for outline in outlines], axis=0) - _MARGIN
    high = np.max([outline.max(axis=0) for outline in outlines], axis=0) + _MARGIN
    texel = (high - low) / _TEXELS
    alpha = np.zeros((_TEXELS, _TEXELS), np.uint8)
    for outline in outlines:
        # Rows count downwards, from the centre of the first one.
        x, y = ((outline - low) / texel).T
        pixels = np.column_stack([x, _TEXELS - y]) - 0.5
        fixed = np.round(16 * pixels).astype(np.int32)
        cv2.fillConvexPoly(alpha, fixed, _DARKNESS, cv2.LINE_AA, 4)
    sx, sy = (_BLUR / texel).tolist()
    alpha = cv2.GaussianBlur(alpha, (0, 0), sx, sigmaY=sy)
    color = np.broadcast_to(np.uint8(_COLOR), (_TEXELS, _TEXELS, 3))  # type: ignore[arg-type]
    (x0, y0), (x1, y1) = low, high
    vertices = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    return np.column_stack([vertices, np.full(4, _HEIGHT)]), np.dstack([color, alpha])


def cast(points: np.ndarray) -> np.ndarray:
    """Returns where the sun's rays through points, (n, 3) m, meet z = 0, (n, 2)."""
    return points[:, :2] - points[:, 2:] / SUN_W[2] * SUN_W[:2]
