"""Sub-pixel corners of marker squares: fits a line to each edge, intersects them."""

import numpy as np

from airrace.common.jit import compiled
from airrace.math.small_matrices import transformed
from airrace.systems.perception.edge_profile import model_lines
from airrace.systems.perception.edges import (
    ACROSS,
    ALONG,
    EXTENT,
    cross,
    intersect,
    make_edges,
    profiles,
)
from airrace.systems.perception.interpolation import as_pixels

# Half a profile in the first and the second pass, as a share of the square's
# width and at most (px): first wide, to find the edge from rough corners, then
# clear of the marker's inner modules (1/7 of the width away) and of the board's
# rim (1/8).
_REACHES = ((0.11, 10.0), (0.085, 5.0))
# Blur carries rim and modules into the profiles of squares narrower than this (px).
_SMALL = 65.0
_FARTHEST = 8.0  # px, from a rough corner to where it is
FARTHEST_SAMPLE = _FARTHEST + 12.0  # px, from the rough square to any pixel that counts
_LEAST_CONTRAST = 8.0  # grey levels, from black to white
_LEAST_POINTS = len(ALONG) / 4  # of a line
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
        corners, (n, 4, 2) px, and the covariance of each square's corners
        x0, y0, x1, ..., (n, 8, 8) px^2; NaN where an edge cannot be seen.
    """
    image, rough = as_pixels(image), np.ascontiguousarray(quads, float).reshape(-1, 4, 2)
    corners, covariance = np.empty(rough.shape), np.empty((len(rough), 8, 8))
    for i in range(len(rough)):
        if not _refit_square(image, rough[i], corners[i], covariance[i]):
            corners[i], covariance[i] = np.nan, np.nan
    return corners, covariance


@compiled
def _refit_square(image, rough, corners, covariance):
    """Refits one square.

    Args:
        image: see grey_levels().
        rough: its rough corners, (4, 2) px.
        corners, covariance: where to write, (4, 2) and (8, 8).

    Returns:
        whether its edges can be seen.
    """
    lines, variances = np.empty((4, 2)), np.empty((4, 2))
    refitted, small = rough, False
    for k in range(len(_REACHES)):
        edges = make_edges(refitted)
        small = min(edges.width) < _SMALL
        for i in range(4):
            reach = min(_REACHES[k][0] * edges.width[i], _REACHES[k][1])
            x, y, contrast = _edge_points(image, edges, i, reach, small or k == 0)
            _fit_line(x, y, contrast, edges.length[i], lines[i], variances[i])
        refitted = intersect(edges, lines)
        if not _is_near(refitted, rough):
            return False
    if small:
        edges = make_edges(refitted)
        refitted = intersect(edges, model_lines(image, edges))
    corners[:] = refitted
    covariance[:] = _corner_covariance(make_edges(refitted), variances)
    return True


@compiled
def _is_near(corners, rough):
    """Whether corners are where they may be; lines through nothing run anywhere."""
    for i in range(4):
        for j in range(2):
            if not abs(corners[i, j] - rough[i, j]) < _FARTHEST:
                return False
    return True


@compiled
def _edge_points(image, edges, i, reach, crowded):
    """Returns where each profile of an edge has its gradient's centroid.

    Args:
        image: see grey_levels().
        edges: of the square.
        i: number of the edge.
        reach: half a profile (px).
        crowded: whether there may be something else in the profiles.

    Returns:
        x along the edge and y outwards, from its middle, (p,) px; and the sums
        of the gradients, (p,) grey levels.
    """
    levels = profiles(image, edges, i, reach)
    x, y, contrast = np.empty(len(ALONG)), np.empty(len(ALONG)), np.empty(len(ALONG))
    for k in range(len(ALONG)):
        total, moment = 0.0, 0.0
        for j in range(len(ACROSS) - 1):
            gradient = levels[k, j + 1] - levels[k, j]
            # What rises outwards is this edge's: rim and modules fall. But so
            # does half of the noise, and there is more of it on the white side.
            if gradient > 0.0 or not crowded:
                total += gradient
                moment += gradient * (ACROSS[j] + ACROSS[j + 1]) / 2
        x[k], y[k] = ALONG[k] * edges.length[i], reach * moment / max(total, 1e-6)
        contrast[k] = total
    return x, y, contrast


@compiled
def _fit_line(x, y, contrast, length, line, variance):
    """Fits y = offset + slope x, without outliers and profiles that show no edge.

    Args:
        x, y, contrast: see _edge_points().
        length: of the edge (px).
        line, variance: where to write offset and slope, (2,), and their
            variances, (2,); NaN where there are too few points.
    """
    n = len(x)
    least = max(0.5 * np.median(contrast), _LEAST_CONTRAST)
    used, residual = np.empty(n, np.bool_), np.empty(n)
    for k in range(n):
        used[k] = contrast[k] > least
    for _ in range(2):
        offset, slope, count, spread = _line(x, y, used)
        for k in range(n):
            residual[k] = abs(y[k] - offset - slope * x[k])
        limit = _OUTLIER * max(1.4826 * np.median(residual), _FLOOR)
        for k in range(n):
            used[k] = contrast[k] > least and residual[k] < limit
    offset, slope, count, spread = _line(x, y, used)
    squares = 0.0
    for k in range(n):
        if used[k]:
            squares += (y[k] - offset - slope * x[k]) ** 2
    # Profiles less than a pixel apart look at the same pixels.
    independent = min(count, count * EXTENT * length / n)
    scatter = squares / max(independent - 2, 1.0)
    line[0], line[1] = offset, slope
    variance[0] = scatter / count + _SYSTEMATIC**2
    variance[1] = scatter / spread + (_SYSTEMATIC / (0.5 * length)) ** 2


@compiled
def _line(x, y, used):
    """Fits y = offset + slope x by least squares to the points in use.

    Returns:
        offset, slope, number of points, and sum of squared deviations of x; NaN
        where there are too few points.
    """
    count, mean_x, mean_y = 0.0, 0.0, 0.0
    for k in range(len(x)):
        if used[k]:
            count, mean_x, mean_y = count + 1.0, mean_x + x[k], mean_y + y[k]
    if count < _LEAST_POINTS:
        return np.nan, np.nan, np.nan, np.nan
    mean_x, mean_y = mean_x / count, mean_y / count
    spread, common = 0.0, 0.0
    for k in range(len(x)):
        if used[k]:
            spread += (x[k] - mean_x) * x[k]
            common += (x[k] - mean_x) * y[k]
    slope = common / spread
    return mean_y - slope * mean_x, slope, count, spread


@compiled
def _corner_covariance(edges, variances):
    """Propagates the variances of offsets and slopes to the corners.

    A corner moves by u with n_i u = (how far line i moves there) for the two
    lines through it.

    Args:
        edges: of the square.
        variances: of offset (px^2) and slope, (4, 2).

    Returns:
        (8, 8) px^2.
    """
    J, of_lines = np.zeros((8, 8)), np.zeros((8, 8))
    for i in range(4):
        previous = (i + 3) % 4
        ax, ay = edges.outward[previous, 0], edges.outward[previous, 1]
        bx, by = edges.outward[i, 0], edges.outward[i, 1]
        determinant = cross(ax, ay, bx, by)
        x, y, half = by / determinant, -bx / determinant, edges.length[previous] / 2
        J[2 * i, 2 * previous], J[2 * i, 2 * previous + 1] = x, x * half
        J[2 * i + 1, 2 * previous], J[2 * i + 1, 2 * previous + 1] = y, y * half
        x, y, half = -ay / determinant, ax / determinant, -edges.length[i] / 2
        J[2 * i, 2 * i], J[2 * i, 2 * i + 1] = x, x * half
        J[2 * i + 1, 2 * i], J[2 * i + 1, 2 * i + 1] = y, y * half
        of_lines[2 * i, 2 * i] = variances[i, 0]
        of_lines[2 * i + 1, 2 * i + 1] = variances[i, 1]
    return transformed(J, of_lines)
