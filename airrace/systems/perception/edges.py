"""The edges of a marker's square in a picture, in machine code, see compiled.py."""

import math
import typing

import numpy as np

from airrace.common.jit import compiled
from airrace.systems.perception.interpolation import grey_levels

# Where edges are sampled: at profiles along them, clear of the corners, in edge
# lengths from the middle; and across, in half profiles, outwards.
EXTENT = 0.7
ALONG = np.linspace(-EXTENT / 2, EXTENT / 2, 24)
ACROSS = np.linspace(-1.0, 1.0, 17)


class Edges(typing.NamedTuple):
    """The edges of a square; edge i leads from corner i to corner i + 1.

    Attributes:
        middle: points halfway, (4, 2) px.
        along, outward: unit vectors, (4, 2).
        length: (4,) px.
        width: distance of the opposite edge, (4,) px.
    """

    middle: np.ndarray
    along: np.ndarray
    outward: np.ndarray
    length: np.ndarray
    width: np.ndarray


@compiled
def make_edges(corners):
    """Returns the Edges of a square from its corners, (4, 2) px."""
    middle, along, outward = np.empty((4, 2)), np.empty((4, 2)), np.empty((4, 2))
    length, width = np.empty(4), np.empty(4)
    for i in range(4):
        j = (i + 1) % 4
        x, y = corners[j, 0] - corners[i, 0], corners[j, 1] - corners[i, 1]
        length[i] = math.hypot(x, y)
        along[i, 0], along[i, 1] = x / length[i], y / length[i]
        outward[i, 0], outward[i, 1] = along[i, 1], -along[i, 0]
        middle[i, 0], middle[i, 1] = corners[i, 0] + x / 2, corners[i, 1] + y / 2
    for i in range(4):
        j = (i + 2) % 4
        width[i] = (middle[i, 0] - middle[j, 0]) * outward[i, 0] + (
            middle[i, 1] - middle[j, 1]
        ) * outward[i, 1]
    return Edges(middle, along, outward, length, width)


@compiled
def profiles(image, edges, i, reach):
    """Returns grey levels at ALONG and ACROSS an edge, (p, s).

    Args:
        image: see grey_levels().
        edges: of a square.
        i: number of the edge.
        reach: half a profile (px).
    """
    count = len(ALONG) * len(ACROSS)
    x, y, result = np.empty(count), np.empty(count), np.empty(count)
    along_x, along_y = edges.along[i, 0], edges.along[i, 1]
    outward_x, outward_y = edges.outward[i, 0], edges.outward[i, 1]
    for k in range(len(ALONG)):
        x_k = edges.middle[i, 0] + ALONG[k] * edges.length[i] * along_x
        y_k = edges.middle[i, 1] + ALONG[k] * edges.length[i] * along_y
        first = k * len(ACROSS)
        for j in range(len(ACROSS)):
            out = ACROSS[j] * reach
            x[first + j], y[first + j] = x_k + out * outward_x, y_k + out * outward_y
    grey_levels(image, x, y, result)
    return result.reshape(len(ALONG), len(ACROSS))


@compiled
def intersect(edges, lines):
    """Returns the corners of a square whose edges are shifted and turned a little, (4, 2) px.

    Args:
        edges: of the square.
        lines: offset outwards at each edge's middle (px), and slope against the
            edge, (4, 2).
    """
    p, d, corners = np.empty((4, 2)), np.empty((4, 2)), np.empty((4, 2))
    for i in range(4):
        for j in range(2):
            p[i, j] = edges.middle[i, j] + lines[i, 0] * edges.outward[i, j]
            d[i, j] = edges.along[i, j] + lines[i, 1] * edges.outward[i, j]
    for i in range(4):
        j = (i + 3) % 4
        to_previous = cross(p[j, 0] - p[i, 0], p[j, 1] - p[i, 1], d[j, 0], d[j, 1])
        s = to_previous / cross(d[i, 0], d[i, 1], d[j, 0], d[j, 1])
        corners[i, 0], corners[i, 1] = p[i, 0] + s * d[i, 0], p[i, 1] + s * d[i, 1]
    return corners


@compiled
def cross(ax, ay, bx, by):
    """Returns the z component of the cross product of two vectors."""
    return ax * by - ay * bx
