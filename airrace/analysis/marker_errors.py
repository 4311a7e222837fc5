"""How far a marker was seen from where it is: for those who know where it is."""

from typing import NamedTuple

import numpy as np
from pydrake.math import RigidTransform

from airrace.systems.types import Detection
from airrace.track import MARKER_SIZE
from airrace.vehicle.camera_info import CameraInfo

# The black square's corners in M, its z axis out of the board; top left first, clockwise.
_CORNERS = MARKER_SIZE / 2 * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0.0]])


class MarkerErrors(NamedTuple):
    """Errors of one detection."""

    #: How far the corners lie outside of the true square, along the lines from its middle; mean of
    #: the four, negative if they are inside (px).
    pull: float
    distance: float  #: measured from the camera, less the true one (m)


def marker_errors(
    detection: Detection, X_WC: RigidTransform, X_WM: RigidTransform, info: CameraInfo
) -> MarkerErrors:
    """Compares a detection with the truth.

    Args:
        detection: of a picture without distortion.
        X_WC: true pose of the camera.
        X_WM: true pose of the marker; see Track.boards().
        info: the camera.
    """
    X_CM = X_WC.inverse() @ X_WM
    truth = true_corners(X_CM, info)
    outwards = truth - truth.mean(axis=0)
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    pull = np.mean(np.sum((detection.corners - truth) * outwards, axis=1))
    measured = np.linalg.norm(detection.X_CM.translation())
    return MarkerErrors(float(pull), float(measured - np.linalg.norm(X_CM.translation())))


def true_corners(X_CM: RigidTransform, info: CameraInfo) -> np.ndarray:
    """Returns where a marker's corners are in a picture, (4, 2) px, by the pinhole camera.

    Args:
        X_CM: pose of the marker in the camera frame, in front of it.
        info: the camera.
    """
    p_C = info.K @ (X_CM @ _CORNERS.T)
    return (p_C[:2] / p_C[2]).T
