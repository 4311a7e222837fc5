"""How the drone is to be turned along a planned trajectory, every few metres of its path."""

from typing import NamedTuple

import numpy as np

from airrace.trajopt.flatness import attitude_from_force, heading_vectors, thrust_vectors
from airrace.trajopt.reference import as_reference

SPACING = 3.0  # m of path between two frames that are shown
_MOST = 2000  # frames; a path that takes more has them farther apart


class BodyFrames(NamedTuple):
    """Poses of the body along a path, in the world, N of them."""

    positions: np.ndarray  #: p_WB (m), (3, N)
    x_axes: np.ndarray  #: where the body's nose points, unit vectors (3, N)
    z_axes: np.ndarray  #: the thrust axis, unit vectors (3, N)


def body_frames(samples: np.ndarray, spacing: float = SPACING) -> BodyFrames:
    """Returns the body's frames along a trajectory, by differential flatness.

    The first is at the trajectory's start. The attitude follows from acceleration and yaw
    alone, see attitude_from_force().

    Args:
        samples: of the trajectory, as in trajopt/reference.py, (18, n) with n > 1, so close
            that the path between two of them is nearly straight.
        spacing: of path from frame to frame (m), at least.
    """
    steps = np.linalg.norm(np.diff(as_reference(samples).position, axis=1), axis=0)
    path = np.concatenate([[0.0], np.cumsum(steps)])
    marks = np.arange(0.0, path[-1] + 1e-9, max(spacing, path[-1] / _MOST))
    at = np.array([np.interp(marks, path, row) for row in samples])
    position, yaw = as_reference(at).position, as_reference(at).yaw
    (x_axes, _, z_axes), *_ = attitude_from_force(
        *thrust_vectors(at), heading_vectors(np.cos(yaw), np.sin(yaw), 0.0, 0.0)
    )
    return BodyFrames(position, x_axes, z_axes)
