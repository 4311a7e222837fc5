"""Arrows as one mesh: hundreds of them cost a page no more than one object."""

import numpy as np
from numpy.typing import ArrayLike

from airrace.trajopt.body_frames import BodyFrames

# As everywhere in robotics: x is red, z is blue.
X_COLOR, Z_COLOR = (0.95, 0.1, 0.1), (0.1, 0.25, 1.0)
_LENGTH, _HEAD = 1.5, 0.6  # m, of an arrow, and of its head alone
_SHAFT_RADIUS, _HEAD_RADIUS = 0.06, 0.22  # m
_SIDES = 3
# An arrow along x: rings of corners, each (x, radius), and the tip.
_RINGS = ((0.0, _SHAFT_RADIUS), (_LENGTH - _HEAD, _SHAFT_RADIUS), (_LENGTH - _HEAD, _HEAD_RADIUS))
_TIP = _SIDES * len(_RINGS)


def arrows(starts: ArrayLike, directions: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Returns the mesh of arrows that are 1.5 m long.

    Args:
        starts: of the arrows (m), (3, n).
        directions: unit vectors, (3, n).

    Returns:
        vertices, (3, 10 n), those of arrow k from 10 k on, the last of them its tip; and
        faces, (3, 15 n).
    """
    starts, along = np.asarray(starts, float).T, np.asarray(directions, float).T
    # Sideways of an arrow is across the axis of the world that it is farthest from.
    across = np.cross(along, np.eye(3)[np.argmin(np.abs(along), axis=1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    frames = np.stack([along, across, np.cross(along, across)], axis=2)  # R_WA, (n, 3, 3)
    corners = starts[:, None] + _unit_vertices() @ frames.swapaxes(1, 2)
    vertices = corners.reshape(-1, 3).T
    first = (_TIP + 1) * np.arange(len(starts))
    faces = (first[:, None, None] + _unit_faces()).reshape(-1, 3).T
    return np.ascontiguousarray(vertices), np.ascontiguousarray(faces, np.int32)


def frame_arrows(frames: BodyFrames) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns the mesh of body frames: a red arrow for each x axis, a blue one for each z axis.

    Returns:
        vertices, (3, m), faces, (3, k), and colours of the vertices, RGB from 0 to 1, (3, m).
    """
    starts = np.hstack([frames.positions, frames.positions])
    vertices, faces = arrows(starts, np.hstack([frames.x_axes, frames.z_axes]))
    count = vertices.shape[1] // 2
    colors = np.repeat(np.array([X_COLOR, Z_COLOR]).T, count, axis=1)
    return vertices, faces, colors


def _unit_vertices():
    """Returns the corners of an arrow from the origin along x, (10, 3)."""
    angles = 2 * np.pi / _SIDES * np.arange(_SIDES)
    rings = [(x, r * np.cos(a), r * np.sin(a)) for x, r in _RINGS for a in angles]
    return np.array([*rings, (_LENGTH, 0.0, 0.0)])


def _unit_faces():
    """Returns the corners of an arrow's triangles, outside seen counter-clockwise, (15, 3)."""
    faces = []
    for i in range(_SIDES):
        j = (i + 1) % _SIDES
        for ring in range(0, _TIP - _SIDES, _SIDES):
            a, b, c, d = ring + i, ring + j, ring + _SIDES + i, ring + _SIDES + j
            faces += [(a, b, d), (a, d, c)]
        faces.append((_TIP - _SIDES + i, _TIP - _SIDES + j, _TIP))
    return np.array(faces)
