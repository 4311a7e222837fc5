"""Finds blurred edges of markers by a model of what lies around them."""

import math

import numpy as np

from airrace.common.jit import compiled
from airrace.math.small_matrices import cholesky, solve_cholesky
from airrace.systems.perception.edges import ACROSS, ALONG, EXTENT, profiles
from airrace.track import BOARD_SIZE, MARKER_SIZE

# In widths of the black square: from its edge out to the board's rim and in to
# its first modules that may be white.
_RIM = (BOARD_SIZE - MARKER_SIZE) / 2 / MARKER_SIZE
_MODULE = 1 / 7
_REACH = 0.17  # half a profile in widths: past rim and modules,
_FARTHEST = 5.0  # and at most (px)
_ITERATIONS = 2
# Standard deviations of what the parameters may be in grey levels or px, in
# terms of a sample's noise. They decide what a profile does not show.
_PRIOR = np.array([200.0, 200.0, 200.0, 200.0, 0.7, 0.35])
_SIGMA = 0.75  # px, the blur to begin with,
_LEAST_SIGMA, _MOST_SIGMA = 0.3, 3.0  # and its limits
_MOST_OFFSET = 1.0  # px


@compiled
def model_lines(image, edges):
    """Returns where the edges of a marker's square lie, by a model of the picture.

    Seen through a camera, the white margin around the square and the frame
    around its modules are so narrow that the blur of the rim and of the modules
    reaches over them and pushes a gradient's centroid off the edge. So a model
    is fitted to the mean profile of each half of an edge, by Gauss-Newton:

        y(x) = a + b Phi(x - d) + c Phi(x - d - rim) + e Phi(-(x - d + module))

    Phi is a step blurred by a Gaussian of standard deviation s; what is fitted
    are the levels a, b, c, e, the offset d and the blur s.

    Args:
        image: see grey_levels().
        edges: of the square, to half a pixel.

    Returns:
        offset of the lines from the edges' middles, outwards (px), and their
        slopes against the edges, (4, 2).
    """
    lines = np.empty((4, 2))
    half = len(ALONG) // 2
    for i in range(4):
        reach = min(_REACH * edges.width[i], _FARTHEST)
        levels = profiles(image, edges, i, reach)
        first = _offset(_mean_profile(levels, 0), reach, edges.width[i])
        second = _offset(_mean_profile(levels, half), reach, edges.width[i])
        lines[i, 0] = (first + second) / 2
        # The middles of the halves are half the profiles' extent apart.
        lines[i, 1] = (second - first) / (EXTENT / 2 * edges.length[i])
    return lines


@compiled
def _mean_profile(levels, start):
    """Returns the mean over half of the profiles of an edge, (s,)."""
    half = len(ALONG) // 2
    mean = np.zeros(len(ACROSS))
    for k in range(start, start + half):
        for j in range(len(ACROSS)):
            mean[j] += levels[k, j] / half
    return mean


@compiled
def _offset(y, reach, width):
    """Returns the offset d of the model that fits a profile (px).

    Args:
        y: grey levels at ACROSS, (s,).
        reach: half the profile (px).
        width: of the square (px).
    """
    first = np.array([y.min(), y.max() - y.min(), 0.0, 0.0, 0.0, _SIGMA])
    q = first.copy()
    for _ in range(_ITERATIONS):
        H, g = np.zeros((6, 6)), np.empty(6)
        for m in range(6):
            H[m, m] = _PRIOR[m] ** -2
            g[m] = -H[m, m] * (q[m] - first[m])
        for j in range(len(y)):
            value, slopes = _model(ACROSS[j] * reach, width, q)
            for m in range(6):
                g[m] += slopes[m] * (y[j] - value)
                for n in range(m + 1):  # Cholesky looks at the lower half
                    H[m, n] += slopes[m] * slopes[n]
        q += solve_cholesky(cholesky(H), g)
        q[4] = min(max(q[4], -_MOST_OFFSET), _MOST_OFFSET)
        q[5] = min(max(q[5], _LEAST_SIGMA), _MOST_SIGMA)
    return q[4]


@compiled
def _model(x, width, q):
    """Returns the model of model_lines(), and its derivatives by its parameters.

    Args:
        x: outwards from the edge (px).
        width: of the square (px).
        q: a, b, c, e, d and s, (6,).
    """
    d, s = q[4], q[5]
    value, by_d, by_s = q[0], 0.0, 0.0
    step, density = _step((x - d) / s)
    value, by_d, by_s = value + q[1] * step, -q[1] * density, -q[1] * density * (x - d) / s
    rim, density = _step((x - d - _RIM * width) / s)
    value += q[2] * rim
    by_d -= q[2] * density
    by_s -= q[2] * density * (x - d - _RIM * width) / s
    module, density = _step(-(x - d + _MODULE * width) / s)
    value += q[3] * module
    by_d += q[3] * density
    by_s += q[3] * density * (x - d + _MODULE * width) / s
    return value, (1.0, step, rim, module, by_d / s, by_s / s)


@compiled
def _step(z):
    """Returns the normal distribution function and its density."""
    return 0.5 * math.erfc(-z / math.sqrt(2.0)), math.exp(-z * z / 2) / math.sqrt(2 * math.pi)
