"""Sub-pixel corners of marker squares: fits a line to each edge and intersects the lines."""

from collections.abc import Sequence

import numpy as np

from airrace.common.jit import compiled
from airrace.math.small_matrices import product
from airrace.systems.perception.edge_profile import model_lines
from airrace.systems.perception.edges import ACROSS, ALONG, EXTENT, intersect, make_edges, profiles
from airrace.systems.perception.interpolation import as_pixels

# Half a profile in the first and the second pass, as a share of the square's
# width and at most (px): first wide, to find the edge from rough corners, then
# clear of the marker's inner modules (1/7 of the width away) and of the board's
# rim (1/8).
_REACHES = ((0.11, 10.0), (0.085, 5.0))
# Blur carries rim and modules into the profiles of squares narrower than this (px).
_SMALL = 65.0
_FARTHEST = 8.0  # px, from a rough corner to the refitted one
FARTHEST_SAMPLE = _FARTHEST + 12.0  # px, from the rough square to any pixel that counts
_LEAST_CONTRAST = 8.0  # grey levels, from black to white
_FITS = 3  # of a line, each without the outliers of the one before
_LEAST_POINTS = len(ALONG) / 4  # of a line
_OUTLIER = 3.0  # robust standard deviations
_LEAST_SIGMA = 0.03  # px, of a robust standard deviation
_SYSTEMATIC = 0.02  # px, error of an edge that does not show in its scatter


def refit(
    image: np.ndarray, quads: Sequence[np.ndarray] | np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Refits the corners of black squares on white boards.

    Along each edge's normals, the edge lies at the centroid of the brightness
    gradient, which no symmetric blur moves; a line through these points is the
    edge, two lines are a corner. Edges of small squares are then moved to where
    a model of their blurred surroundings puts them: see edge_profile.py.

    Args:
        image: grey levels, (h, w), uint8; pixel centres are integers.
        quads: corners to a pixel or two, clockwise as seen, (n, 4, 2) px.

    Returns:
        corners, (n, 4, 2) px, and the covariance of each square's corners
        x0, y0, x1, ..., (n, 8, 8) px^2; NaN where an edge cannot be seen.
    """
    image, quads = as_pixels(image), np.ascontiguousarray(quads, float).reshape(-1, 4, 2)
    corners, covariances = np.empty(quads.shape), np.empty((len(quads), 8, 8))
    for i, quad in enumerate(quads):
        corners[i], covariances[i] = _refit_square(image, quad)
    return corners, covariances


@compiled
def _refit_square(image, quad):
    """Returns the corners of one square, (4, 2) px, and their covariance; see refit()."""
    unseen = np.full((4, 2), np.nan), np.full((8, 8), np.nan)
    lines, variances = np.empty((4, 2)), np.empty((4, 2))
    corners, is_small = quad, False
    for k in range(len(_REACHES)):
        share, farthest = _REACHES[k]
        edges = make_edges(corners)
        is_small = edges.width.min() < _SMALL
        for i in range(4):
            reach = min(share * edges.width[i], farthest)
            lines[i], variances[i] = _fit_edge(image, edges, i, reach, is_small or k == 0)
        corners = intersect(edges, lines)
        # Lines that follow no edge may meet anywhere, or be NaN.
        if not np.all(np.abs(corners - quad) < _FARTHEST):
            return unseen
    if is_small:
        edges = make_edges(corners)
        corners = intersect(edges, model_lines(image, edges))
    return corners, _corner_covariance(make_edges(corners), variances)


@compiled
def _fit_edge(image, edges, i, reach, is_crowded):
    """Fits y = offset + slope x by least squares to where profiles of an edge have their centroids.

    x is along the edge and y outwards, from its middle. Outliers and profiles that show no edge
    do not count.

    Args:
        image, edges, i, reach: see profiles().
        is_crowded: whether there may be something else in the profiles.

    Returns: (offset (px), slope), and their variances; NaN where there are too few points.
    """
    levels = profiles(image, edges, i, reach)
    gradient = levels[:, 1:] - levels[:, :-1]
    if is_crowded:
        # What rises outwards belongs to this edge: rim and modules fall. But so
        # does half of the noise, and there is more of it on the white side.
        gradient = np.maximum(gradient, 0.0)
    contrast = gradient.sum(axis=1)
    moment = gradient @ ((ACROSS[1:] + ACROSS[:-1]) / 2)
    length = edges.length[i]
    x, y = ALONG * length, reach * moment / np.maximum(contrast, 1e-6)
    visible = contrast > max(0.5 * np.median(contrast), _LEAST_CONTRAST)
    fitted = used = visible
    for _ in range(_FITS):
        count = used.sum()
        if count < _LEAST_POINTS:
            return (np.nan, np.nan), (np.nan, np.nan)
        deviation = x[used] - x[used].mean()
        spread = (deviation * deviation).sum()
        slope = (deviation * y[used]).sum() / spread
        offset = y[used].mean() - slope * x[used].mean()
        residual = y - offset - slope * x
        limit = _OUTLIER * max(1.4826 * np.median(np.abs(residual)), _LEAST_SIGMA)
        fitted, used = used, visible & (np.abs(residual) < limit)
    residual = residual[fitted]
    # Profiles less than a pixel apart sample the same pixels.
    independent = min(count, count * EXTENT * length / len(x))
    scatter = (residual * residual).sum() / max(independent - 2.0, 1.0)
    offset_variance = scatter / count + _SYSTEMATIC**2
    slope_variance = scatter / spread + (_SYSTEMATIC / (0.5 * length)) ** 2
    return (offset, slope), (offset_variance, slope_variance)


@compiled
def _corner_covariance(edges, variances):
    """Propagates the variances of offsets and slopes to the corners.

    The normals n_i, n_j of the two lines through a corner and the distances by which the
    lines move there give the corner's motion u: n_i u = d_i, n_j u = d_j.

    Args: edges: of the square. variances: of offset (px^2) and slope, (4, 2).

    Returns: (8, 8) px^2.
    """
    J = np.zeros((8, 8))
    for i in range(4):
        j = (i + 3) % 4  # the edge before
        (ax, ay), (bx, by) = edges.outward[j], edges.outward[i]
        determinant = ax * by - ay * bx
        u_j = np.array((by, -bx)) / determinant
        u_i = np.array((-ay, ax)) / determinant
        for k in range(2):
            row = 2 * i + k
            J[row, 2 * j], J[row, 2 * j + 1] = u_j[k], u_j[k] * edges.length[j] / 2
            J[row, 2 * i], J[row, 2 * i + 1] = u_i[k], -u_i[k] * edges.length[i] / 2
    return product(J * variances.ravel(), J.T)
