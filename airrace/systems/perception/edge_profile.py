"""Finds blurred edges of markers by a model of what lies around them."""

import math
from typing import NamedTuple

import numpy as np

from airrace.common.jit import compiled
from airrace.common.packing import Packing
from airrace.math.small_matrices import cholesky, product, solve_cholesky
from airrace.systems.perception.edges import ACROSS, ALONG, EXTENT, Edges, profiles
from airrace.track import BOARD_SIZE, MARKER_SIZE

# In widths of the black square: from its edge out to the board's rim and in to
# its first modules that may be white.
_RIM = (BOARD_SIZE - MARKER_SIZE) / 2 / MARKER_SIZE
_MODULE = 1 / 7
_REACH = 0.17  # half a profile in widths: past rim and modules,
_FARTHEST = 5.0  # and at most (px);
_FARTHEST_OF_BLURRED = 9.0  # px, where 5 would show too little around an edge
_BLURRED = 1.2  # px, blur s from which on that is so
_ITERATIONS = 2
_SIGMA = 0.75  # px, the blur to begin with,
_LEAST_SIGMA, _MOST_SIGMA = 0.3, 3.0  # and its limits
_SHARP = 0.7  # px, blur s up to which an edge keeps its direction
_MOST_OFFSET = 1.0  # px


class _Blur(NamedTuple):
    """The parameters of the model, see model_lines().

    Attributes: a, b, c, e: levels (grey levels). d: offset (px). s: blur (px).
    """

    a: float
    b: float
    c: float
    e: float
    d: float
    s: float


_AT, _vector = Packing(_Blur).at, Packing(_Blur).vector
# Standard deviations of the parameters before the fit, if that of a sample is one grey level. They
# decide what a profile does not show.
_PRIOR = _vector(_Blur(200.0, 200.0, 200.0, 200.0, d=0.7, s=0.35))


@compiled
def model_lines(image: np.ndarray, edges: Edges) -> np.ndarray:
    """Returns where the edges of a marker's square lie, by a model of the picture.

    Seen through a camera, the white margin around the square and the frame
    around its modules are so narrow that the blur of the rim and of the modules
    reaches over them and pushes a gradient's centroid off the edge. So a model
    is fitted to the mean profile of each half of an edge, by Gauss-Newton:

        y(x) = a + b Phi((x - d) / s) + c Phi((x - d - rim) / s) + e Phi(-(x - d + module) / s)

    Phi is the normal distribution function: a step blurred by a Gaussian of standard
    deviation s. Fitted are the levels a, b, c, e, the offset d and the blur s.
    The two offsets also say how an edge is turned, but less well than all its centroids do
    where blur does not disturb them: a sharp edge is moved, and keeps its direction.

    Args:
        image: see grey_levels().
        edges: of the square, to half a pixel, in the direction of their centroids.

    Returns:
        offset of the lines from the edges' middles, outwards (px), and their
        slopes against the edges, (4, 2).
    """
    lines = np.zeros((4, 2))
    half = len(ALONG) // 2
    for i in range(4):
        width, first, second, s = edges.width[i], 0.0, 0.0, 0.0
        for farthest in (_FARTHEST, _FARTHEST_OF_BLURRED):
            reach = min(_REACH * width, farthest)
            levels = profiles(image, edges, i, reach)
            first, s_first = _fit_profile(levels[:half].sum(axis=0) / half, reach, width)
            second, s_second = _fit_profile(levels[half:].sum(axis=0) / half, reach, width)
            s = (s_first + s_second) / 2
            if not s > _BLURRED or reach < farthest:
                break
        lines[i, 0] = (first + second) / 2
        if s > _SHARP:
            # The middles of the halves are half the profiles' extent apart.
            lines[i, 1] = (second - first) / (EXTENT / 2 * edges.length[i])
    return lines


@compiled
def _fit_profile(y, reach, width):
    """Returns the offset d and the blur s of the model that fits a profile (px).

    Args: y: grey levels at ACROSS, (s,). reach: half the profile (px). width: of the square (px).
    """
    x, weights = ACROSS * reach, _PRIOR**-2
    prior = _vector(_Blur(y.min(), y.max() - y.min(), 0.0, 0.0, 0.0, _SIGMA))
    q = prior.copy()
    for _ in range(_ITERATIONS):
        error, J = y.copy(), np.ones((len(x), 6))
        a, b, c, e, d, s = q
        for j in range(len(x)):
            z, z_rim = (x[j] - d) / s, (x[j] - d - _RIM * width) / s
            z_module = -(x[j] - d + _MODULE * width) / s
            (step, slope), (rim, rim_slope) = _normal(z), _normal(z_rim)
            module, module_slope = _normal(z_module)
            error[j] -= a + b * step + c * rim + e * module
            by_z, by_rim, by_module = b * slope, c * rim_slope, e * module_slope
            J[j, _AT.b], J[j, _AT.c], J[j, _AT.e] = step, rim, module
            J[j, _AT.d] = (-by_z - by_rim + by_module) / s
            J[j, _AT.s] = -(by_z * z + by_rim * z_rim + by_module * z_module) / s
        H = product(J.T, J) + np.diag(weights)
        q += solve_cholesky(cholesky(H), J.T @ error - weights * (q - prior))
        q[_AT.d] = min(max(q[_AT.d], -_MOST_OFFSET), _MOST_OFFSET)
        q[_AT.s] = min(max(q[_AT.s], _LEAST_SIGMA), _MOST_SIGMA)
    return q[_AT.d], q[_AT.s]


@compiled
def _normal(z):
    """Returns the normal distribution function, and the density, which is its derivative."""
    return 0.5 * math.erfc(-z / math.sqrt(2.0)), math.exp(-z * z / 2) / math.sqrt(2 * math.pi)
