"""The faces of marker boards: how white every pixel is."""

import functools
import math

import numpy as np

from airrace.common.jit import compilable, compiled
from airrace.rendering.scene.textures import BLACK, WHITE, marker_modules
from airrace.track import MARKER_SIZE

_MODULES = 7  # a side of a marker, with its black frame
# Maps (u, v, 1), in modules from the marker's upper left corner, to the board's plane.
_MODULES_TO_M = np.array(
    [
        [MARKER_SIZE / _MODULES, 0.0, -MARKER_SIZE / 2],
        [0.0, -MARKER_SIZE / _MODULES, MARKER_SIZE / 2],
        [0.0, 0.0, 1.0],
    ]
)
_MOST_SAMPLES = 4  # of a pixel in either direction
_ZERO, _HALF, _ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)
_1, _2, _3 = np.int32(1), np.int32(2), np.int32(3)
_LAST = np.float32(_MODULES)
_CONTRAST = np.float32(WHITE - BLACK)


@functools.cache
def marker_crossings(marker_id: int) -> np.ndarray:
    """Returns what meets at every crossing of the lines between a marker's modules.

    Args:
        marker_id: ArUco ID in DICT_ARUCO_ORIGINAL.

    Returns:
        int32, (8,), of the lines from the top; in each, four bits for every line from the
        left: whether white is upper left, upper right, lower left, lower right of where they
        cross, from the least.
    """
    white = np.pad(marker_modules(marker_id), 1, constant_values=True).astype(np.uint32)
    codes = white[:-1, :-1] + 2 * white[:-1, 1:] + 4 * white[1:, :-1] + 8 * white[1:, 1:]
    return np.bitwise_or.reduce(codes << 4 * np.arange(_MODULES + 1), axis=1).astype(np.int32)


@compilable
def modules_from_pixels(H, result) -> None:
    """Finds the map from pixels (x, y, 1) to a marker's modules, up to a factor.

    Args:
        H: maps (x, y, 1) of the board's plane to homogeneous pixels, (3, 3).
        result: where to put it, (3, 3).
    """
    A = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                A[i, j] += H[i, k] * _MODULES_TO_M[k, j]
    for i in range(3):
        for j in range(3):
            a, b, c, d = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            result[i, j] = A[a, c] * A[b, d] - A[a, d] * A[b, c]


@compilable
def find_samples(to_modules, x, y, samples) -> None:
    """Finds into how many parts to divide pixels, along rows and columns.

    A part should not show more than one crossing of lines.

    Args:
        to_modules: see modules_from_pixels().
        x, y: the middle of the board.
        samples: where to put the numbers, (2,).
    """
    U, V, W = to_modules
    w = W[0] * x + W[1] * y + W[2]
    u, v = (U[0] * x + U[1] * y + U[2]) / w, (V[0] * x + V[1] * y + V[2]) / w
    for i in range(2):
        modules = max(abs(U[i] - u * W[i]), abs(V[i] - v * W[i])) / abs(w)
        samples[i] = int(math.ceil(max(modules, 1.0))) if modules < _MOST_SAMPLES else _MOST_SAMPLES


@compiled
def face_levels(scratch, n, to_modules, crossings, anchor, skipped, y, samples):
    """Finds the grey levels of a row of pixels on the face of a board, white around it.

    A pixel is the mean over its area: of the modules on all sides of the nearest
    crossing, weighted as if lines across and lines down were hit independently. That is
    exact but where a pixel shows a corner.

    Args:
        scratch: (5, n or more), float32.
        n: number of pixels.
        to_modules: see modules_from_pixels().
        crossings: see marker_crossings().
        anchor: first column and middle one of the board, [x, x].
        skipped: columns from there to the first pixel.
        y: the row.
        samples: see find_samples().

    Returns:
        the levels, (n,), float32, a part of scratch.
    """
    levels = scratch[0][:n]
    column, right, row, below = scratch[1][:n], scratch[2][:n], scratch[3][:n], scratch[4][:n]
    c0, c1, c2, c3 = crossings[0], crossings[1], crossings[2], crossings[3]
    c4, c5, c6, c7 = crossings[4], crossings[5], crossings[6], crossings[7]
    across, down = samples[0], samples[1]
    weight = _CONTRAST / np.float32(across * down)
    levels[:] = np.float32(BLACK)
    U, V, W = to_modules[0], to_modules[1], to_modules[2]
    for i in range(across * down):
        x_i = anchor[0] + (i // down + 0.5) / across - 0.5
        y_i = y + (i % down + 0.5) / down - 0.5
        _find_lines(column, right, U, W, x_i, anchor[1], skipped, y_i, across, down)
        _find_lines(row, below, V, W, x_i, anchor[1], skipped, y_i, across, down)
        for k in range(len(levels)):
            # A look-up, or a loop, would take several times as long: it is no SIMD code.
            code = c1 if row[k] >= np.float32(1) else c0
            code = c2 if row[k] >= np.float32(2) else code
            code = c3 if row[k] >= np.float32(3) else code
            code = c4 if row[k] >= np.float32(4) else code
            code = c5 if row[k] >= np.float32(5) else code
            code = c6 if row[k] >= np.float32(6) else code
            code = c7 if row[k] >= np.float32(7) else code
            code = np.int32(code >> np.int32(np.int32(4) * np.int32(column[k])))
            a, b = np.float32(code & _1), np.float32((code >> _1) & _1)
            upper = a + right[k] * (b - a)
            a, b = np.float32((code >> _2) & _1), np.float32((code >> _3) & _1)
            lower = a + right[k] * (b - a)
            levels[k] += weight * (upper + below[k] * (lower - upper))
    return levels


@compiled
def _find_lines(lines, beyond, U, W, x, x_m, skipped, y, across, down) -> None:
    """Finds which line is nearest to every pixel of a row, and how much is beyond it.

    A pixel is a parallelogram across the line: its width is distributed as the sum of two
    uniform numbers, which is a trapezium.

    Args:
        lines, beyond: where to put numbers of lines, and shares of pixels, (n,), float32.
        U, W: (3,), u = U (x, y, 1) / W (x, y, 1) counts the lines.
        x, x_m, skipped, y: see face_levels().
        across, down: parts of a pixel.
    """
    # How fast u grows along a pixel's sides hardly changes along the row.
    w_m = W[0] * x_m + W[1] * y + W[2]
    u_m = (U[0] * x_m + U[1] * y + U[2]) / w_m
    a, b = abs((U[0] - u_m * W[0]) / w_m) / across, abs((U[1] - u_m * W[1]) / w_m) / down
    long, short = max(a, b) + 1e-6, min(a, b) + 1e-6
    half, short, per_long = np.float32((long + short) / 2), np.float32(short), np.float32(1 / long)
    per_short = np.float32(0.5) / short
    u_0, u_x = np.float32(U[0] * x + U[1] * y + U[2]), np.float32(U[0])
    w_0, w_x = np.float32(W[0] * x + W[1] * y + W[2]), np.float32(W[0])
    for k in range(len(lines)):
        t = np.float32(k + skipped)
        u = (u_0 + t * u_x) / (w_0 + t * w_x)
        line = np.floor(u + _HALF)
        line = line if line > _ZERO else _ZERO  # NaN, too
        line = line if line < _LAST else _LAST
        rest = max(half - abs(u - line), _ZERO)
        slope = min(rest, short)
        tail = (slope * slope * per_short + rest - slope) * per_long
        lines[k], beyond[k] = line, _ONE - tail if u > line else tail
