"""Reads the modules of a marker again, at its refitted corners."""

import functools

import cv2
import numpy as np

from airrace.common.jit import compiled
from airrace.systems.perception.interpolation import as_pixels, grey_levels
from airrace.track import BOARD_SIZE, MARKER_SIZE

DICTIONARY = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_ARUCO_ORIGINAL)
_MODULES = 7  # a side, with the black frame
_WITHIN = np.array([-0.25, 0.0, 0.25])  # samples of a module, in either direction


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
    return _misread(as_pixels(grey), np.ascontiguousarray(corners, float), _modules(id))


def read_marker(grey, quad) -> tuple | None:
    """Reads a square that may be any marker of the dictionary, or the board around one.

    Args:
        grey: the image, (h, w), uint8.
        quad: corners, clockwise as seen, (4, 2) px.

    Returns:
        ID, and the marker's corners, top left first as it is read; None if it is none.
    """
    grey, quad = as_pixels(grey), np.ascontiguousarray(quad, float)
    for corners in (quad, _within(quad, MARKER_SIZE / BOARD_SIZE)):
        if (code := _code(grey, corners)) in _codes():
            id, first = _codes()[code]
            return id, np.roll(corners, -first, axis=0)
    return None


@functools.cache
def _codes() -> dict:
    """Returns, by what _code() reads, the ID and which corner is the top left one."""
    bits = np.unpackbits(DICTIONARY.bytesList, axis=2).astype(int)  # (n, quarter turns, 32)
    codes = np.concatenate([bits[:, :, :24], bits[:, :, 31:]], axis=2) @ 2 ** np.arange(25)
    # The last one counts: marker 1023 looks the same upside down.
    return {
        code: (id, -turns % 4)
        for turns in (3, 2, 1, 0)
        for id, code in enumerate(codes[:, turns].tolist())
    }


@functools.cache
def _modules(id) -> np.ndarray:
    """Returns where a marker is white, (7, 7); the frame is black."""
    return cv2.aruco.generateImageMarker(DICTIONARY, id, _MODULES) > 0


@compiled
def _misread(grey, corners, white):
    levels = _module_levels(grey, corners)
    # Half-way between the mean white module and the mean black one.
    bright, dark, bright_count = 0.0, 0.0, 0
    for i in range(_MODULES):
        for j in range(_MODULES):
            if white[i, j]:
                bright, bright_count = bright + levels[i, j], bright_count + 1
            else:
                dark += levels[i, j]
    middle = (bright / bright_count + dark / (_MODULES**2 - bright_count)) / 2
    wrong = 0
    for i in range(1, _MODULES - 1):
        for j in range(1, _MODULES - 1):
            wrong += (levels[i, j] > middle) != white[i, j]
    return wrong


@compiled
def _code(grey, quad) -> int:
    """Returns the inner modules of a square as bits, -1 if its frame is not black."""
    levels = _module_levels(grey, quad)
    last, middle = _MODULES - 1, (levels.max() + levels.min()) / 2
    code, bit = 0, 1
    for i in range(_MODULES):
        for j in range(_MODULES):
            white = levels[i, j] > middle
            if i in (0, last) or j in (0, last):
                if white:
                    return -1
            else:
                code, bit = code + white * bit, 2 * bit
    return code


@compiled
def _module_levels(grey, corners):
    """Returns the mean grey level of each module's inner half, (7, 7)."""
    a, b, c, d, e, f, g, h = _square_to_quad(corners)
    looks = len(_WITHIN) ** 2
    x, y = np.empty(_MODULES**2 * looks), np.empty(_MODULES**2 * looks)
    n = 0
    for i in range(_MODULES):
        for j in range(_MODULES):
            for dv in _WITHIN:
                for du in _WITHIN:
                    u, v = (j + 0.5 + du) / _MODULES, (i + 0.5 + dv) / _MODULES
                    w = g * u + h * v + 1.0
                    x[n], y[n] = (a * u + b * v + c) / w, (d * u + e * v + f) / w
                    n += 1
    each, levels = np.empty(n), np.zeros((_MODULES, _MODULES))
    grey_levels(grey, x, y, each)
    for k in range(n):
        module = k // looks
        levels[module // _MODULES, module % _MODULES] += each[k]
    return levels / looks


@compiled
def _within(quad, share):
    """Returns the corners of a smaller square in the middle of one, (4, 2)."""
    a, b, c, d, e, f, g, h = _square_to_quad(quad)
    corners = np.empty((4, 2))
    for k in range(4):
        u = (1.0 + (share if k in (1, 2) else -share)) / 2
        v = (1.0 + (share if k in (2, 3) else -share)) / 2
        w = g * u + h * v + 1.0
        corners[k] = (a * u + b * v + c) / w, (d * u + e * v + f) / w
    return corners


@compiled
def _square_to_quad(p):
    """Returns the projective map of the unit square to four corners, (4, 2).

    x = (a u + b v + c) / (g u + h v + 1) and y = (d u + e v + f) / (g u + h v + 1);
    Heckbert, "Fundamentals of texture mapping and image warping", 1989, 2.2.3.
    """
    (x0, y0), (x1, y1), (x2, y2), (x3, y3) = p[0], p[1], p[2], p[3]
    sx, sy = x0 - x1 + x2 - x3, y0 - y1 + y2 - y3
    determinant = (x1 - x2) * (y3 - y2) - (x3 - x2) * (y1 - y2)
    g = (sx * (y3 - y2) - sy * (x3 - x2)) / determinant
    h = ((x1 - x2) * sy - (y1 - y2) * sx) / determinant
    return (x1 - x0 + g * x1, x3 - x0 + h * x3, x0, y1 - y0 + g * y1, y3 - y0 + h * y3, y0, g, h)
