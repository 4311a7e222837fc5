"""Points, directions and segments in the plane."""

import numpy as np
from numpy.typing import ArrayLike


def directions(angles: ArrayLike) -> np.ndarray:
    """Returns unit vectors of angles (rad), shape (..., 2)."""
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def point_distances(points: np.ndarray, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Returns distances of points from segments (m).

    Args:
        points, starts, ends: arrays that broadcast to (..., 2).
    """
    along = ends - starts
    share = np.sum((points - starts) * along, axis=-1)
    share = np.clip(share / np.maximum(np.sum(along * along, axis=-1), 1e-12), 0.0, 1.0)
    return np.linalg.norm(starts + share[..., None] * along - points, axis=-1)


def segment_distances(starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Returns the distances of n segments from one another, 0 where they cross, (n, n) m.

    Args:
        starts, ends: (n, 2).
    """
    a, b = starts[:, None], ends[:, None]
    gaps = np.minimum(point_distances(starts, a, b), point_distances(ends, a, b))
    apart = _side(a, b, starts) * _side(a, b, ends) >= 0  # both ends of j beside line i
    return np.where(apart | apart.T, np.minimum(gaps, gaps.T), 0.0)


def _side(a, b, points):
    return np.sign((b - a)[..., 0] * (points - a)[..., 1] - (b - a)[..., 1] * (points - a)[..., 0])
