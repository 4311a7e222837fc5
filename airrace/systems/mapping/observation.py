"""A marker as one image puts it into the world, and what is refused before it gets there."""

import dataclasses as dc
import math

import numpy as np
from pydrake.math import RigidTransform

from airrace.common.immutable import Immutable, read_only
from airrace.common.jit import compiled
from airrace.math.small_matrices import cholesky, transformed
from airrace.systems.perception.detection_checks import FOREIGN_ID, FROM_BEHIND
from airrace.systems.perception.marker_pose import GATE_SPACING
from airrace.systems.types import CameraInfo, Detection
from airrace.track import MARKER_SIZE

# Why a detection does not enter the map, beside the detector's own reasons.
UNKNOWN_TIME = "no pose of the drone at that time"
BROKEN = "pose or covariance makes no sense"
TOO_FAR = "beyond the range"
OFF_MAP = "far from the map"
UNCONFIRMED = "not yet confirmed"

# Errors that images close to each other share, or that the corners' scatter
# does not show: standard deviations.
_POSITION = 0.005  # m, of the drone
_ATTITUDE = 1e-3  # rad, of the drone
_PULL = 1e-3  # rad, by which the corners may be pulled inwards together
_HEADING = np.deg2rad(3.0)  # of the normal of one board
_FLIP = np.deg2rad(40.0)  # of a normal that may be the wrong one of two
_WORTHLESS = 100.0  # m^2 and rad^2: from such a variance on, a pose says nothing
_CORNER = 0.3  # px, of corners whose covariance nobody gave


@dc.dataclass(frozen=True, eq=False)
class Observation(Immutable):
    """One marker in one image, in the world.

    Attributes:
        id: the ArUco ID.
        time: of the image (s).
        p_WC: position of the camera (m), (3,).
        p_WM: position of the board's centre (m), (3,).
        covariance: of p_WM (m^2), (3, 3).
        normal: unit vector out of the board's face, (3,).
        heading_variance: of the normal's direction about the vertical (rad^2).
        joint: see Detection.
    """

    id: int
    time: float
    p_WC: np.ndarray
    p_WM: np.ndarray
    covariance: np.ndarray
    normal: np.ndarray
    heading_variance: float
    joint: bool = False


def refusal(marker: Detection, max_id: int, max_range: float) -> str | None:
    """Returns why a detection cannot be a board of the track, None if it can.

    Args:
        marker: the detection.
        max_id: the highest possible ID.
        max_range: of the observations that are used (m).
    """
    if not 0 <= marker.id <= max_id:
        return FOREIGN_ID
    X_CM = marker.X_CM.GetAsMatrix34()
    covariance = marker.covariance
    if not np.isfinite(X_CM).all() or (covariance is not None and not _is_covariance(covariance)):
        return BROKEN
    x, y, z = p_CM = X_CM[:, 3].tolist()
    if math.hypot(*p_CM) > max_range:
        return TOO_FAR
    # Nobody can read a board whose face points away, or that is behind the camera.
    out = X_CM[:, 2].tolist()
    if z <= 0.0 or out[0] * x + out[1] * y + out[2] * z >= 0.0:
        return FROM_BEHIND
    return None


def make_observation(
    marker: Detection, X_WC: RigidTransform, info: CameraInfo, time: float
) -> Observation:
    """Returns a detection in the world.

    The position's covariance is the detector's, turned into the world, and
    what the errors of the drone's pose and of the depth add to it: something of
    a known size at a depth z seems z^2 / size times an angle farther away if
    its corners seem that angle closer together.

    Args:
        marker: a detection that refusal() lets pass.
        X_WC: pose of the camera when the image was taken.
        info: the camera's calibration.
        time: of the image (s).
    """
    p_CM = marker.X_CM.translation()
    covariance = marker.covariance
    if covariance is None:
        covariance = read_only(_assumed_covariance(p_CM[2], info.K[0, 0]))
    size = GATE_SPACING if marker.joint else MARKER_SIZE
    X_WM = X_WC @ marker.X_CM
    in_world = _in_world(X_WC.rotation().matrix(), p_CM, covariance, size)
    return Observation(
        id=marker.id,
        time=time,
        p_WC=read_only(X_WC.translation()),
        p_WM=read_only(X_WM.translation()),
        covariance=read_only(in_world[:3, :3]),
        normal=read_only(X_WM.rotation().col(2)),
        heading_variance=float(in_world[3, 3]) + _HEADING**2 + (_FLIP * marker.ambiguity) ** 2,
        joint=marker.joint,
    )


@compiled
def _in_world(R_WC, p_CM, covariance, size):
    """Returns the covariance of a marker's x, y, z (m) and turn about the vertical (rad), (4, 4).

    Args:
        R_WC: rotation of the camera, (3, 3).
        p_CM: position of the marker (m), (3,).
        covariance: of the marker's pose in C, see Detection, (6, 6).
        size: of what the distance was told by (m).
    """
    J = np.zeros((4, 6))
    for i in range(3):
        J[3, i] = R_WC[2, i]
        for j in range(3):
            J[i, 3 + j] = R_WC[i, j]
    result = transformed(J, covariance)
    ray, squared = np.zeros(3), 0.0
    for i in range(3):
        squared += p_CM[i] ** 2
        for j in range(3):
            ray[i] += R_WC[i, j] * p_CM[j]
    pull = (_PULL * squared / size) ** 2 / squared
    for i in range(3):
        result[i, i] += _POSITION**2 + _ATTITUDE**2 * squared
        for j in range(3):
            result[i, j] += pull * ray[i] * ray[j]
    return result


@compiled
def _is_covariance(matrix):
    """Whether a matrix is finite and small, and no variance in it is negative."""
    largest = 0.0
    for element in matrix.ravel():
        if not abs(element) < _WORTHLESS:
            return False
        largest = max(largest, abs(element))
    lifted = matrix.copy()
    for i in range(len(matrix)):
        lifted[i, i] += 1e-9 * largest + 1e-300  # rounding is no reason
    return not math.isnan(cholesky(lifted)[-1, -1])


def _assumed_covariance(depth, focal_length) -> np.ndarray:
    """Returns that of a marker's pose in the camera from its depth (m) alone, (6, 6)."""
    angle = _CORNER / focal_length
    across, along = depth * angle, depth**2 * angle / MARKER_SIZE
    turn = depth * angle / MARKER_SIZE
    # A board that is seen head-on hardly shows that it turns.
    return np.diag([4 * turn, 4 * turn, turn, across, across, along]) ** 2
