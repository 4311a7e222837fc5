"""The faces of marker boards, anti-aliased: the mean of every pixel over its area.

A homography takes pixels to (u, v) in modules from the upper left corner of the marker, so the
lines between modules are where u or v is a whole number.
"""

import functools
import math
import typing

import numpy as np

from airrace.common.jit import compilable, compiled
from airrace.rendering.scene.textures import BLACK, WHITE, marker_modules
from airrace.track import MARKER_SIZE

_MODULES = 7  # a side of a marker, with its black frame
# Maps (u, v, 1) to (x, y, 1) in the board's plane (m).
_MODULES_TO_M = np.array(
    [
        [MARKER_SIZE / _MODULES, 0.0, -MARKER_SIZE / 2],
        [0.0, -MARKER_SIZE / _MODULES, MARKER_SIZE / 2],
        [0.0, 0.0, 1.0],
    ]
)
_MOST_SAMPLES = 4  # of a pixel along either side
_LAST = np.float32(_MODULES)
_CONTRAST = np.float32(WHITE - BLACK)
_BIT, _TWO, _THREE = np.int32(1), np.int32(2), np.int32(3)
_ZERO, _HALF, _ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)

# The face of a board in a picture.
FACE = np.dtype(
    [
        ("to_modules", np.float64, (3, 3)),  # the homography, up to a factor
        ("crossings", np.int32, 8),  # see marker_crossings()
        ("first", np.float64),  # column
        ("middle", np.float64),  # column
        ("samples", np.int64, 2),  # of a pixel along a row, and along a column
    ],
    align=True,
)


class _SampleRow(typing.NamedTuple):
    """Samples of a row of pixels: points (x + k, y), k = skipped, skipped + 1, ..."""

    x: float
    y: float
    skipped: int
    middle: float  #: the middle column of the face
    #: across, down: how many samples a pixel has along its sides
    across: int
    down: int


@functools.cache
def marker_crossings(marker_id: int) -> np.ndarray:
    """Returns what meets at every crossing of the lines between a marker's modules, int32, (8,).

    For each line from the top it has four bits for every line from the left: whether white is
    upper left, upper right, lower left, lower right of where they cross, from the least.
    """
    white = np.pad(marker_modules(marker_id), 1, constant_values=True).astype(np.uint32)
    codes = white[:-1, :-1] + 2 * white[:-1, 1:] + 4 * white[1:, :-1] + 8 * white[1:, 1:]
    return np.bitwise_or.reduce(codes << 4 * np.arange(_MODULES + 1), axis=1).astype(np.int32)


@compilable
def set_face(
    face: np.record, H: np.ndarray, crossings: np.ndarray, first: int, middle: float
) -> None:
    """Fills a FACE.

    A pixel is divided into samples such that none shows more than one crossing of lines.

    Args:
        H: homography from (x, y, 1) of the board's plane to pixels, (3, 3).
        crossings: see marker_crossings(). first, middle: columns of the board.
    """
    columns = (H @ _MODULES_TO_M).T.copy()
    to_modules = face.to_modules
    # The adjugate, which is the inverse up to a factor.
    for i in range(3):
        to_modules[i] = np.cross(columns[(i + 1) % 3], columns[(i + 2) % 3])
    face.crossings[:] = crossings
    face.first, face.middle = first, middle
    U, V, W = to_modules
    x, y = H[0, 2] / H[2, 2], H[1, 2] / H[2, 2]
    w = W[0] * x + W[1] * y + W[2]
    u, v = (U[0] * x + U[1] * y + U[2]) / w, (V[0] * x + V[1] * y + V[2]) / w
    for k in range(2):
        modules = max(abs(U[k] - u * W[k]), abs(V[k] - v * W[k])) / abs(w)  # along a pixel's side
        few = modules < _MOST_SAMPLES
        face.samples[k] = int(math.ceil(max(modules, 1.0))) if few else _MOST_SAMPLES


@compiled
def face_levels(face: np.record, start: int, stop: int, y: int, scratch: np.ndarray) -> np.ndarray:
    """Returns the grey levels of a row of pixels on the face of a board, white around it.

    A sample is the mean over its area: of the modules on all sides of the nearest
    crossing, weighted as if lines across and lines down were hit independently. That is
    exact but where a sample shows a corner.

    Args:
        face: a FACE.
        start, stop: the columns of the first pixel, and of the one after the last. y: the row.
        scratch: (5, stop - start or more), float32; changed: the levels are a part of it.
    """
    n = stop - start
    levels = scratch[0][:n]
    column, right, row, below = scratch[1][:n], scratch[2][:n], scratch[3][:n], scratch[4][:n]
    c0, c1, c2, c3, c4, c5, c6, c7 = face.crossings
    across, down = face.samples
    U, V, W = face.to_modules
    weight = _CONTRAST / np.float32(across * down)
    levels[:] = np.float32(BLACK)
    for i in range(across * down):
        x_i = face.first + (i // down + 0.5) / across - 0.5
        y_i = y + (i % down + 0.5) / down - 0.5
        samples = _SampleRow(x_i, y_i, start - int(face.first), face.middle, across, down)
        _find_lines(column, right, U, W, samples)
        _find_lines(row, below, V, W, samples)
        for k in range(n):
            # Selections are SIMD code; a look-up would take several times as long.
            code = c1 if row[k] >= np.float32(1) else c0
            code = c2 if row[k] >= np.float32(2) else code
            code = c3 if row[k] >= np.float32(3) else code
            code = c4 if row[k] >= np.float32(4) else code
            code = c5 if row[k] >= np.float32(5) else code
            code = c6 if row[k] >= np.float32(6) else code
            code = c7 if row[k] >= np.float32(7) else code
            code = np.int32(code >> np.int32(np.int32(4) * np.int32(column[k])))
            a, b = np.float32(code & _BIT), np.float32((code >> _BIT) & _BIT)
            c, d = np.float32((code >> _TWO) & _BIT), np.float32((code >> _THREE) & _BIT)
            upper, lower = a + right[k] * (b - a), c + right[k] * (d - c)
            levels[k] += weight * (upper + below[k] * (lower - upper))
    return levels


@compiled
def _find_lines(lines, beyond, U, W, samples):
    """Finds which line is nearest to every sample of a row, and how much of it is beyond.

    A sample is a parallelogram across the line: its width is distributed as the sum of two
    uniform numbers, which is a trapezium.

    Args:
        lines, beyond: where to put numbers of lines, and shares of samples, (n,), float32.
        U, W: (3,), u = U (x, y, 1) / W (x, y, 1) counts the lines.
        samples: the row, a _SampleRow.
    """
    x, y = samples.x, samples.y
    # How fast u grows along a pixel's sides hardly changes along the row.
    w_m = W[0] * samples.middle + W[1] * y + W[2]
    u_m = (U[0] * samples.middle + U[1] * y + U[2]) / w_m
    a = abs((U[0] - u_m * W[0]) / w_m) / samples.across
    b = abs((U[1] - u_m * W[1]) / w_m) / samples.down
    long, short = max(a, b) + 1e-6, min(a, b) + 1e-6
    half, short, per_long = np.float32((long + short) / 2), np.float32(short), np.float32(1 / long)
    per_short = np.float32(0.5) / short
    u_0, u_x = np.float32(U[0] * x + U[1] * y + U[2]), np.float32(U[0])
    w_0, w_x = np.float32(W[0] * x + W[1] * y + W[2]), np.float32(W[0])
    for k in range(len(lines)):
        t = np.float32(k + samples.skipped)
        u = (u_0 + t * u_x) / (w_0 + t * w_x)
        line = np.floor(u + _HALF)
        line = line if line > _ZERO else _ZERO  # NaN, too
        line = line if line < _LAST else _LAST
        rest = max(half - abs(u - line), _ZERO)
        slope = min(rest, short)
        tail = (slope * slope * per_short + rest - slope) * per_long
        lines[k], beyond[k] = line, _ONE - tail if u > line else tail
