"""One marker in one image, in world coordinates, and the checks before that."""

import math
import typing

import numpy as np
from pydrake.math import RigidTransform

from airrace.common.immutable import read_only
from airrace.common.jit import compiled
from airrace.math.small_matrices import cholesky, propagated
from airrace.math.vec3 import dot, rotate
from airrace.systems.perception.detection_checks import FOREIGN_ID, FROM_BEHIND
from airrace.systems.perception.marker_pose import GATE_SPACING, assumed_covariance
from airrace.systems.types import Detection
from airrace.track import MARKER_SIZE
from airrace.vehicle.camera_info import CameraInfo

# Why a detection does not enter the map, beside the detector's own reasons.
UNKNOWN_TIME = "no pose of the drone at that time"
BROKEN = "corners, pose or covariance make no sense"
TOO_FAR = "beyond the range"
INVALID = "at the origin of the world"  # the position in a message that nobody filled in
OFF_MAP = "far from the map"
UNCONFIRMED = "not yet confirmed"

# Errors that images close to each other share, or that the corners' scatter
# does not show: standard deviations.
_POSITION = 0.005  # m, of the drone
_ATTITUDE = 1e-3  # rad, of the drone
_RADIAL = 1e-3  # rad, of all corners towards the marker's centre
_HEADING = np.deg2rad(3.0)  # of the normal of one board
_FLIP = np.deg2rad(40.0)  # of a normal that may be the wrong one of two
_MOST_VARIANCE = 100.0  # m^2 and rad^2: a pose with more says nothing
_FARTHEST = 1e6  # m: a pose that is farther away is broken, whatever the range


class Observation(typing.NamedTuple):
    """One marker in one image, in world coordinates."""

    id: int  #: the ArUco ID
    time: float  #: of the image (s)
    p_WC: np.ndarray  #: position of the camera (m), (3,)
    p_WM: np.ndarray  #: position of the board's centre (m), (3,)
    covariance: np.ndarray  #: of p_WM (m^2), (3, 3)
    normal: np.ndarray  #: unit vector out of the board's face, (3,)
    heading_variance: float  #: of the normal's direction about the vertical (rad^2)
    joint: bool = False  #: see Detection


def refusal(marker: Detection, max_id: int, max_range: float) -> str | None:
    """Returns why a detection cannot be a board of the track, None if it can.

    Args:
        marker: the detection.
        max_id: the highest possible ID.
        max_range: of the observations that are used (m), perhaps infinite.
    """
    if not 0 <= marker.id <= max_id:
        return FOREIGN_ID
    X_CM = marker.X_CM.GetAsMatrix34()
    covariance = marker.covariance
    is_finite = np.isfinite(X_CM).all() and np.isfinite(marker.corners).all()
    if not is_finite or (covariance is not None and not _is_covariance(covariance)):
        return BROKEN
    x, y, z = X_CM[:, 3].tolist()
    distance = math.hypot(x, y, z)
    if distance > max_range:
        return TOO_FAR
    if distance > _FARTHEST:
        return BROKEN
    # A board that faces away, or is behind the camera, cannot be read.
    if z <= 0.0 or X_CM[:, 2] @ X_CM[:, 3] >= 0.0:
        return FROM_BEHIND
    return None


def make_observation(
    marker: Detection, X_WC: RigidTransform, info: CameraInfo, time: float
) -> Observation:
    """Returns a detection in world coordinates.

    The position's covariance is the detector's, rotated into the world, plus that of
    the drone's pose and of errors that all corners share: see _world_covariance().

    Args:
        marker: a detection that refusal() accepts.
        X_WC: pose of the camera when the image was taken.
        info: the camera's calibration.
        time: of the image (s).
    """
    p_CM = marker.X_CM.translation()
    covariance = marker.covariance
    if covariance is None:
        covariance = read_only(assumed_covariance(p_CM[2], info.K[0, 0]))
    size = GATE_SPACING if marker.joint else MARKER_SIZE
    X_WM = X_WC @ marker.X_CM
    in_world = _world_covariance(X_WC.rotation().matrix(), p_CM, covariance, size)
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
def _world_covariance(R_WC, p_CM, covariance, size):
    """Returns the covariance of a marker's x, y, z (m) and rotation about the vertical, (4, 4).

    If all corners of something of a known size seem nearer to its centre by an angle, then
    its distance r seems greater by that angle times r^2 / size.

    Args:
        R_WC: rotation of the camera, (3, 3).
        p_CM: position of the marker (m), (3,).
        covariance: of the marker's pose in C, see Detection, (6, 6).
        size: of what the distance was determined by (m).
    """
    J = np.zeros((4, 6))
    J[:3, 3:] = R_WC
    J[3, :3] = R_WC[2]
    result = propagated(J, covariance)
    ray = rotate(R_WC, p_CM)
    squared = dot(ray, ray)
    range_variance = (_RADIAL * squared / size) ** 2
    result[:3, :3] += (_POSITION**2 + _ATTITUDE**2 * squared) * np.eye(3)
    result[:3, :3] += range_variance / squared * np.outer(ray, ray)
    return result


@compiled
def _is_covariance(matrix):
    """Whether a matrix is finite and small, and no variance in it is negative."""
    greatest = np.abs(matrix).max()
    if not greatest < _MOST_VARIANCE:  # NaN is not
        return False
    # Something is added to the diagonal, because rounding is no fault.
    rounding = 1e-9 * greatest + 1e-300
    return not math.isnan(cholesky(matrix + rounding * np.eye(len(matrix)))[-1, -1])
