"""Paths as thin tubes: WebGL draws every line one pixel wide, and in one colour."""

import numpy as np
from numpy.typing import ArrayLike

_SIDES = 3


def tube(points: ArrayLike, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns a triangular tube around a path.

    Args:
        points: of the path, (n, 3) m, n > 1.
        radius: of the tube's edges (m).

    Returns:
        vertices, (3, 3 n), those of point k from 3 k on; and faces, (3, 6 (n - 1)).
    """
    points = np.asarray(points, float)
    along = _unit(np.gradient(points, axis=0), [1.0, 0.0, 0.0])
    # Sideways is level; straight up or down, any sideways is as good.
    side = _unit(np.cross(along, [0.0, 0.0, 1.0]), [0.0, 1.0, 0.0])
    up = np.cross(side, along)
    angles = np.pi / 2 + 2 * np.pi / _SIDES * np.arange(_SIDES)
    corners = [points + radius * (np.cos(a) * side + np.sin(a) * up) for a in angles]
    vertices = np.stack(corners, axis=1).reshape(-1, 3)
    first = _SIDES * np.arange(len(points) - 1)
    faces = []
    for i in range(_SIDES):
        a, b = first + i, first + (i + 1) % _SIDES
        faces += [np.stack([a, b + _SIDES, b]), np.stack([a, a + _SIDES, b + _SIDES])]
    return np.ascontiguousarray(vertices.T), np.hstack(faces).astype(np.int32)


def _unit(vectors, otherwise):
    """Returns the vectors at unit length, and another one for those that have none."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(lengths > 1e-9, vectors / np.maximum(lengths, 1e-9), otherwise)
