"""Reads the modules of a marker again, at its refitted corners."""

import functools

import cv2
import numpy as np

DICTIONARY = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_ARUCO_ORIGINAL)
_MODULES = 7  # a side, with the black frame
_SAMPLES = 3  # of a module in either direction, over its inner half
_CENTRES = np.arange(_MODULES) + 0.5
_WITHIN = np.linspace(-0.25, 0.25, _SAMPLES)
_GRID = np.stack(
    np.meshgrid(*2 * [(_CENTRES[:, None] + _WITHIN).ravel()]), axis=2
).reshape(1, -1, 2).astype(np.float32)
_CORNERS = np.float32([[0, 0], [1, 0], [1, 1], [0, 1]]) * _MODULES


def misread_modules(grey, corners, id) -> int:
    """Returns how many modules of a marker are not as its ID says.

    OpenCV reads them at rough corners: those of small markers it may read one
    beside the other. IDs of this dictionary differ by three modules or more.

    Args:
        grey: the image, (h, w), uint8.
        corners: refitted, top left first, clockwise as the marker is read,
            (4, 2) px.
        id: what the marker was read as.
    """
    to_pixels = cv2.getPerspectiveTransform(_CORNERS, corners.astype(np.float32))
    points = cv2.perspectiveTransform(_GRID, to_pixels)
    side = _MODULES, _SAMPLES
    levels = cv2.remap(
        grey, points.reshape(_MODULES * _SAMPLES, -1, 2), None, cv2.INTER_LINEAR
    ).reshape(*side, *side).mean(axis=(1, 3))
    white = _modules(id)
    middle = (levels[white].mean() + levels[~white].mean()) / 2
    return int(np.sum((levels > middle)[1:-1, 1:-1] != white[1:-1, 1:-1]))


@functools.cache
def _modules(id) -> np.ndarray:
    """Returns where a marker is white, (7, 7); the frame is black."""
    return cv2.aruco.generateImageMarker(DICTIONARY, id, _MODULES) > 0
