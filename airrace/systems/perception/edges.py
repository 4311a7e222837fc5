"""The edges of a marker's square in a picture."""

import typing

import numpy as np

from airrace.common.jit import compiled
from airrace.systems.perception.interpolation import grey_levels

# Where edges are sampled: at profiles along them, clear of the corners, in edge
# lengths from the middle; and across, in half profiles, outwards.
EXTENT = 0.7
ALONG = np.linspace(-EXTENT / 2, EXTENT / 2, 24)
ACROSS = np.linspace(-1.0, 1.0, 17)
_NEXT, _OPPOSITE, _PREVIOUS = np.array([1, 2, 3, 0]), np.array([2, 3, 0, 1]), np.array([3, 0, 1, 2])


class Edges(typing.NamedTuple):
    """The edges of a square; edge i leads from corner i to corner i + 1."""

    middle: np.ndarray  #: points halfway, (4, 2) px
    #: along, outward: unit vectors, (4, 2)
    along: np.ndarray
    outward: np.ndarray
    length: np.ndarray  #: (4,) px
    width: np.ndarray  #: distance of the opposite edge, (4,) px


@compiled
def make_edges(corners: np.ndarray) -> Edges:
    """Returns the Edges of a square from its corners, (4, 2) px."""
    sides = corners[_NEXT] - corners
    length = np.hypot(sides[:, 0], sides[:, 1])
    along = sides / length.reshape(4, 1)
    outward = np.stack((along[:, 1], -along[:, 0]), axis=1)
    middle = corners + sides / 2
    across = middle - middle[_OPPOSITE]
    width = across[:, 0] * outward[:, 0] + across[:, 1] * outward[:, 1]
    return Edges(middle, along, outward, length, width)


@compiled
def profiles(image: np.ndarray, edges: Edges, i: int, reach: float) -> np.ndarray:
    """Returns grey levels at ALONG and ACROSS an edge, (p, s).

    Args:
        image: see grey_levels().
        edges: of a square.
        i: number of the edge.
        reach: half a profile (px).
    """
    along, across = (ALONG * edges.length[i]).reshape(-1, 1), ACROSS * reach
    x = edges.middle[i, 0] + along * edges.along[i, 0] + across * edges.outward[i, 0]
    y = edges.middle[i, 1] + along * edges.along[i, 1] + across * edges.outward[i, 1]
    return grey_levels(image, x.ravel(), y.ravel()).reshape(x.shape)


@compiled
def intersect(edges: Edges, lines: np.ndarray) -> np.ndarray:
    """Returns the corners of a square whose edges are shifted and turned a little, (4, 2) px.

    Args:
        edges: of the square.
        lines: offset outwards at each edge's middle (px), and slope against the
            edge, (4, 2).
    """
    p = edges.middle + lines[:, :1] * edges.outward
    d = edges.along + lines[:, 1:] * edges.outward
    before = d[_PREVIOUS]
    normal = np.stack((before[:, 1], -before[:, 0]), axis=1)
    s = ((p[_PREVIOUS] - p) * normal).sum(axis=1) / (d * normal).sum(axis=1)
    return p + s.reshape(4, 1) * d
