"""Sub-pixel corners of marker squares: fits a line to each edge, intersects them."""

import numpy as np

from airrace.systems.edge_profile import model_lines
from airrace.systems.edges import ACROSS, ALONG, EXTENT, Edges, cross, intersect, make_edges

_BETWEEN = ((ACROSS[1:] + ACROSS[:-1]) / 2).astype(np.float32)  # samples of a profile
# Half a profile in the first and the second pass, as a share of the square's
# width and at most (px): first wide, to find the edge from rough corners, then
# clear of the marker's inner modules (1/7 of the width away) and of the board's
# rim (1/8).
_REACHES = ((0.11, 10.0), (0.085, 5.0))
# Blur carries rim and modules into the profiles of squares narrower than this (px).
_SMALL = 65.0
_FARTHEST = 20.0  # px, from a rough corner to where it is
FARTHEST_SAMPLE = _FARTHEST + 12.0  # px, from the rough square to any pixel that counts
_LEAST_CONTRAST = 8.0  # grey levels, from black to white
_OUTLIER = 3.0  # robust standard deviations
_FLOOR = 0.03  # px, of a robust standard deviation
_SYSTEMATIC = 0.02  # px, error of an edge that does not show in its scatter


def refit(image, quads):
    """Refits the corners of black squares on white boards.

    Along each edge's normals, the edge lies at the centroid of the brightness
    gradient, which no symmetric blur moves; a line through these points is the
    edge, two lines are a corner. Edges of small squares are then moved to where
    a model of their blurred surroundings puts them: see edge_profile.py.

    Args:
        image: grey levels, (h, w), uint8; pixel centres are integers.
        quads: corners to a pixel or two, clockwise as seen, (n, 4, 2) px.

    Returns:
        corners, (n, 4, 2) px, NaN where an edge cannot be seen; and the
        covariance of each square's corners x0, y0, x1, ..., (n, 8, 8) px^2.
    """
    rough = np.asarray(quads, float).reshape(-1, 4, 2)
    if len(rough) == 0:
        return rough, np.zeros((0, 8, 8))
    corners, lost = rough, np.zeros(len(rough), bool)
    for i, (share, limit) in enumerate(_REACHES):
        edges = make_edges(corners)
        small = edges.width.min(axis=1) < _SMALL
        offset, slope, variance = _fit_lines(image, edges, share, limit, small | (i == 0))
        corners = intersect(edges, offset, slope)
        # Lines through nothing run anywhere.
        lost |= ~np.all(np.abs(corners - rough) < _FARTHEST, axis=(1, 2))
        corners[lost] = rough[lost]
    if np.any(small):
        edges = make_edges(corners[small])
        corners[small] = intersect(edges, *model_lines(image, edges))
    covariance = _corner_covariance(make_edges(corners), variance)
    corners[lost] = np.nan
    return corners, covariance


def _fit_lines(image, edges: Edges, share, limit, crowded):
    """Fits a line to the gradients' centroids of each edge.

    Args:
        image: (h, w), uint8.
        edges: of n squares.
        share, limit: half a profile in widths, and at most (px).
        crowded: whether there may be something else in a square's profiles, (n,).

    Returns:
        offset of the line from the edge's middle, outwards, and its slope
        against the edge, both (n, 4); their variances, (n, 4, 2).
    """
    reach = np.minimum(share * edges.width, limit)
    n = len(reach)
    profiles = edges.profiles(image, reach)
    gradient = profiles[:, :, 1:] - profiles[:, :, :-1]
    # What rises outwards is this edge's: rim and modules fall. But so does half
    # of the noise, and there is more of it on the white side.
    gradient[np.repeat(crowded, 4)[:, None, None] & (gradient < 0)] = 0.0
    contrast = gradient.sum(axis=2).reshape(n, 4, len(ALONG))
    y = reach[:, :, None] * (gradient @ _BETWEEN).reshape(n, 4, len(ALONG))
    y = y / np.maximum(contrast, 1e-6)
    x = ALONG * edges.length[:, :, None]
    seen = contrast > np.maximum(0.5 * _median(contrast), _LEAST_CONTRAST)
    weight = seen.astype(float)
    for _ in range(2):
        offset, slope, moments = _weighted_line(x, y, weight)
        residual = np.abs(y - offset[..., None] - slope[..., None] * x)
        sigma = 1.4826 * _median(residual)
        weight = seen * (residual < _OUTLIER * np.maximum(sigma, _FLOOR))
    offset, slope, (count, spread) = _weighted_line(x, y, weight)
    residual = y - offset[..., None] - slope[..., None] * x
    # Profiles less than a pixel apart look at the same pixels.
    independent = np.minimum(count, count * EXTENT * edges.length / len(ALONG))
    scatter = (weight * residual**2).sum(axis=2) / np.maximum(independent - 2, 1.0)
    variance = np.stack([
        scatter / count + _SYSTEMATIC**2,
        scatter / spread + (_SYSTEMATIC / (0.5 * edges.length)) ** 2,
    ], axis=2)
    return offset, slope, variance


def _median(a):
    """Returns the median over the last axis of an array (n, 4, p), p even, as (n, 4, 1).

    numpy's own takes four times as long on so few.
    """
    half = a.shape[2] // 2
    ordered = np.sort(a, axis=2)
    return (ordered[..., half - 1:half] + ordered[..., half:half + 1]) / 2


def _weighted_line(x, y, weight):
    """Fits y = offset + slope x by least squares over the last axis.

    Returns:
        offset, slope, and (sum of weights, weighted sum of squared deviations
        of x); NaN where there are too few points.
    """
    count = weight.sum(axis=2)
    count = np.where(count < len(ALONG) / 4, np.nan, count)
    mean_x, mean_y = ((weight * a).sum(axis=2) / count for a in (x, y))
    deviation = weight * (x - mean_x[..., None])
    spread = (deviation * x).sum(axis=2)
    slope = (deviation * y).sum(axis=2) / spread
    return mean_y - slope * mean_x, slope, (count, spread)


def _corner_covariance(edges: Edges, variance):
    """Propagates the variances of offsets and slopes to the corners.

    A corner moves by u with n_i u = (how far line i moves there) for the two
    lines through it.

    Args:
        edges: of n squares.
        variance: of offset (px^2) and slope, (n, 4, 2).

    Returns:
        (n, 8, 8) px^2.
    """
    n = len(variance)
    J = np.zeros((n, 4, 2, 4, 2))
    for i in range(4):
        a, b = edges.outward[:, i - 1], edges.outward[:, i]
        det = cross(a, b)[:, None]
        by_previous = np.stack([b[:, 1], -b[:, 0]], axis=1) / det
        by_next = np.stack([-a[:, 1], a[:, 0]], axis=1) / det
        J[:, i, :, i - 1, 0] = by_previous
        J[:, i, :, i - 1, 1] = by_previous * edges.length[:, i - 1, None] / 2
        J[:, i, :, i, 0] = by_next
        J[:, i, :, i, 1] = -by_next * edges.length[:, i, None] / 2
    J = J.reshape(n, 8, 8)
    return (J * variance.reshape(n, 1, 8)) @ J.transpose(0, 2, 1)
