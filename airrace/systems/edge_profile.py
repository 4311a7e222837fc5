"""Finds blurred edges of markers by a model of what lies around them."""

import numpy as np

from airrace.systems.edges import ACROSS, ALONG, EXTENT, Edges
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
_SIGMA_LIMITS = (0.3, 3.0)  # and its limits


def model_lines(image, edges: Edges):
    """Returns where the edges of marker squares lie, by a model of the picture.

    Seen through a camera, the white margin around the square and the frame
    around its modules are so narrow that the blur of the rim and of the modules
    reaches over them and pushes a gradient's centroid off the edge. So a model
    is fitted to the mean profile of each half of an edge, by Gauss-Newton:

        y(x) = a + b Phi(x - d) + c Phi(x - d - rim) + e Phi(-(x - d + module))

    Phi is a step blurred by a Gaussian of standard deviation s; what is fitted
    are the levels a, b, c, e, the offset d and the blur s.

    Args:
        image: grey levels, (h, w), uint8.
        edges: of n squares, to half a pixel.

    Returns:
        offset of the lines from the edges' middles, outwards, (n, 4) px, and
        their slopes against the edges, (n, 4).
    """
    n = len(edges.width)
    reach = np.minimum(_REACH * edges.width, _FARTHEST)
    y = edges.profiles(image, reach).reshape(8 * n, len(ALONG) // 2, -1)
    y = y.mean(axis=1, dtype=float)
    x = np.repeat(ACROSS * reach.reshape(4 * n, 1), 2, axis=0)[:, :, None]
    width = np.repeat(edges.width.reshape(4 * n, 1), 2, axis=0)
    steps = width * [0.0, _RIM, -_MODULE]
    signs = np.array([1.0, 1.0, -1.0])
    weights = 1 / _PRIOR**2
    first = np.zeros((8 * n, 6))
    first[:, 0], first[:, 1], first[:, 5] = y.min(axis=1), np.ptp(y, axis=1), _SIGMA
    q = first.copy()
    J = np.ones((*y.shape, 6))
    for _ in range(_ITERATIONS):
        sigma = q[:, None, 5:]
        z = signs * (x - q[:, None, 4:5] - steps[:, None]) / sigma
        J[:, :, 1:4] = _step(z)
        density = q[:, None, 1:4] * np.exp(-z * z / 2) / (np.sqrt(2 * np.pi) * sigma)
        J[:, :, 4] = -density @ signs
        J[:, :, 5] = -np.sum(density * z, axis=2)
        residual = y - (J[:, :, :4] @ q[:, :4, None])[:, :, 0]
        JT = J.transpose(0, 2, 1)
        gradient = (JT @ residual[:, :, None])[:, :, 0] - weights * (q - first)
        q += np.linalg.solve(JT @ J + np.diag(weights), gradient[:, :, None])[:, :, 0]
        q[:, 4] = np.clip(q[:, 4], -1.0, 1.0)
        q[:, 5] = np.clip(q[:, 5], *_SIGMA_LIMITS)
    first, second = q[:, 4].reshape(n, 4, 2).transpose(2, 0, 1)
    # The middles of the halves are half the profiles' extent apart.
    return (first + second) / 2, (second - first) / (EXTENT / 2 * edges.length)


def _step(z):
    """The normal distribution function to 1e-3, which is quicker than exact."""
    return 0.5 + 0.5 * np.tanh(np.sqrt(2 / np.pi) * (z + 0.044715 * (z * z * z)))
