"""The edges of marker squares in pictures."""

import dataclasses as dc

import cv2
import numpy as np

# Where edges are sampled: at profiles along them, clear of the corners, in edge
# lengths from the middle; and across, in half profiles, outwards.
EXTENT = 0.7
ALONG = np.linspace(-EXTENT / 2, EXTENT / 2, 24)
ACROSS = np.linspace(-1.0, 1.0, 17)


@dc.dataclass(frozen=True)
class Edges:
    """The edges of n squares; edge i leads from corner i to corner i + 1.

    Attributes:
        middle: points halfway, (n, 4, 2) px.
        along, outward: unit vectors, (n, 4, 2).
        length: (n, 4) px.
        width: distance of the opposite edge, (n, 4) px.
    """

    middle: np.ndarray
    along: np.ndarray
    outward: np.ndarray
    length: np.ndarray
    width: np.ndarray

    def profiles(self, image, reach):
        """Returns grey levels at ALONG and ACROSS the edges, (4 n, p, s), float32.

        Args:
            image: (h, w), uint8; pixel centres are integers.
            reach: half a profile, (n, 4) px.
        """
        n, p, s = len(self.middle), len(ALONG), len(ACROSS)
        starts = self.middle[:, :, None] + ALONG[:, None] * (
            self.length[:, :, None, None] * self.along[:, :, None])
        steps = ACROSS[:, None] * (reach[:, :, None, None] * self.outward[:, :, None])
        points = (starts[:, :, :, None] + steps[:, :, None]).astype(np.float32)
        sampled = cv2.remap(
            image, points.reshape(4 * n * p, s, 2), None, cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE)
        return sampled.reshape(4 * n, p, s).astype(np.float32)


def make_edges(corners) -> Edges:
    """Returns the edges of squares from their corners, (n, 4, 2) px."""
    ahead = np.concatenate([corners[:, 1:], corners[:, :1]], axis=1)
    side = ahead - corners
    length = np.hypot(side[..., 0], side[..., 1])
    along = side / length[..., None]
    outward = np.stack([along[..., 1], -along[..., 0]], axis=2)
    middle = (corners + ahead) / 2
    opposite = np.concatenate([middle[:, 2:], middle[:, :2]], axis=1)
    width = np.sum((middle - opposite) * outward, axis=2)
    return Edges(middle, along, outward, length, width)


def intersect(edges: Edges, offset, slope):
    """Returns the corners of squares whose edges are shifted and turned a little.

    Args:
        edges: of n squares.
        offset: outwards, at the edges' middles, (n, 4) px.
        slope: against the edges, (n, 4).

    Returns:
        (n, 4, 2) px.
    """
    p = edges.middle + offset[..., None] * edges.outward
    d = edges.along + slope[..., None] * edges.outward
    q, e = (np.concatenate([a[:, -1:], a[:, :-1]], axis=1) for a in (p, d))
    return p + (cross(q - p, e) / cross(d, e))[..., None] * d


def cross(a, b):
    """Returns the z component of the cross products of vectors, (..., 2)."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
