"""Reads the modules of markers that OpenCV could not read, or read at rough corners."""

import functools

import cv2
import numpy as np

from airrace.common.jit import compiled
from airrace.systems.perception.interpolation import as_pixels, grey_levels
from airrace.track import BOARD_SIZE, MARKER_SIZE

DICTIONARY = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_ARUCO_ORIGINAL)
_MODULES = 7  # a side, with the black frame
_BITS = 2 ** np.arange(25)  # one for each module within the frame, row by row
_IS_INNER = np.pad(np.full((5, 5), True), 1).ravel()  # within the frame
_UNIT_SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)


def _sample_points() -> np.ndarray:
    """Returns points in the inner half of each module, in homogeneous coordinates, (9 * 49, 3)."""
    within = np.array([0.25, 0.5, 0.75])
    v, u, row, column = np.meshgrid(
        within, within, np.arange(_MODULES), np.arange(_MODULES), indexing="ij"
    )
    points = np.stack([(column + u) / _MODULES, (row + v) / _MODULES, np.ones(u.shape)], axis=-1)
    return np.ascontiguousarray(points.reshape(-1, 3))


_SAMPLES = _sample_points()


def misread_modules(grey: np.ndarray, corners: np.ndarray, id: int) -> int:
    """Returns how many modules of a marker are not as its ID says.

    OpenCV reads them at rough corners: those of small markers it may read one
    beside the other. IDs of this dictionary differ by three modules or more.

    Args:
        grey: the image, (h, w), uint8.
        corners: refitted, top left first, clockwise as the marker is read,
            (4, 2) px.
        id: what the marker was read as.
    """
    levels, white = _module_levels(as_pixels(grey), _homography(corners)), _white_modules(id)
    middle = (levels[white].mean() + levels[~white].mean()) / 2
    return int(((levels > middle) != white)[_IS_INNER].sum())


def read_marker(grey: np.ndarray, quad: np.ndarray) -> tuple | None:
    """Reads a square that may be any marker of the dictionary, or the board around one.

    Args: grey: the image, (h, w), uint8. quad: corners, clockwise as seen, (4, 2) px.

    Returns: ID, and the marker's corners, top left first as it is read; None if it is none.
    """
    grey, margin = as_pixels(grey), (1.0 - MARKER_SIZE / BOARD_SIZE) / 2
    within = margin + (1.0 - 2 * margin) * _UNIT_SQUARE
    for corners in (quad, cv2.perspectiveTransform(within[None], _homography(quad))[0]):
        if (code := _code(grey, _homography(corners))) in _codes():
            id, first = _codes()[code]
            return id, np.roll(corners, -first, axis=0).astype(float)
    return None


def _homography(corners: np.ndarray) -> np.ndarray:
    """Returns the projective map of the unit square to corners (4, 2), as a matrix (3, 3)."""
    return cv2.getPerspectiveTransform(_UNIT_SQUARE, np.asarray(corners, np.float32))


@functools.cache
def _codes() -> dict:
    """Returns, by what _code() reads, the ID and which corner is the top left one."""
    bits = np.unpackbits(DICTIONARY.bytesList, axis=2).astype(int)  # type: ignore[arg-type]  # (n, turns, 32)
    codes = np.concatenate([bits[:, :, :24], bits[:, :, 31:]], axis=2) @ _BITS
    # The last one counts: marker 1023 looks the same upside down.
    return {
        code: (id, -turns % 4)
        for turns in (3, 2, 1, 0)
        for id, code in enumerate(codes[:, turns].tolist())
    }


@functools.cache
def _white_modules(id: int) -> np.ndarray:
    """Returns which modules of a marker are white, row by row, (49,); the frame is black."""
    return cv2.aruco.generateImageMarker(DICTIONARY, id, _MODULES).ravel() > 0


def _code(grey, homography):
    """Returns the inner modules of a square as bits, -1 if its frame is not black."""
    levels = _module_levels(grey, homography)
    white = levels > (levels.max() + levels.min()) / 2
    return -1 if white[~_IS_INNER].any() else int((white[_IS_INNER] * _BITS).sum())


@compiled
def _module_levels(grey, homography):
    """Returns the mean grey level of each module's inner half, row by row, (49,)."""
    p = _SAMPLES @ homography.T
    levels = grey_levels(grey, p[:, 0] / p[:, 2], p[:, 1] / p[:, 2]).reshape(-1, _MODULES**2)
    return levels.sum(axis=0) / len(levels)
