"""A marker as one image puts it into the world, and what is refused before it gets there."""

import dataclasses as dc

import numpy as np
from pydrake.math import RigidTransform

from airrace.immutable import Immutable, read_only
from airrace.systems.detection_checks import FOREIGN_ID, FROM_BEHIND
from airrace.systems.marker_pose import GATE_SPACING
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
class Sighting(Immutable):
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
        max_range: of the sightings that are used (m).
    """
    if not 0 <= marker.id <= max_id:
        return FOREIGN_ID
    X_CM = marker.X_CM.GetAsMatrix34()
    if not np.isfinite(X_CM).all() or not _is_covariance(marker.covariance):
        return BROKEN
    if np.abs(X_CM[:, 3]).max() > max_range or np.linalg.norm(X_CM[:, 3]) > max_range:
        return TOO_FAR
    # Nobody can read a board whose face points away, or that is behind the camera.
    if X_CM[2, 3] <= 0.0 or X_CM[:, 2] @ X_CM[:, 3] >= 0.0:
        return FROM_BEHIND
    return None


def make_sighting(marker: Detection, X_WC: RigidTransform, info: CameraInfo,
                  time: float) -> Sighting:
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
    R_WC = X_WC.rotation().matrix()
    distance = np.linalg.norm(p_CM)
    covariance = marker.covariance
    if covariance is None:
        covariance = _assumed_covariance(p_CM[2], info.K[0, 0])
    size = GATE_SPACING if marker.joint else MARKER_SIZE
    ray = R_WC @ p_CM / distance
    X_WM = X_WC @ marker.X_CM
    return Sighting(
        id=marker.id,
        time=time,
        p_WC=read_only(X_WC.translation()),
        p_WM=read_only(X_WM.translation()),
        covariance=read_only(
            R_WC @ covariance[3:, 3:] @ R_WC.T
            + (_POSITION**2 + (_ATTITUDE * distance) ** 2) * np.eye(3)
            + (_PULL * distance**2 / size) ** 2 * np.outer(ray, ray)
        ),
        normal=read_only(X_WM.rotation().col(2)),
        heading_variance=float(
            R_WC[2] @ covariance[:3, :3] @ R_WC[2]
            + _HEADING**2
            + (_FLIP * marker.ambiguity) ** 2
        ),
        joint=marker.joint,
    )


def _is_covariance(matrix) -> bool:
    """Whether it is None or finite and small, and no variance in it is negative."""
    return matrix is None or bool(
        np.abs(matrix).max() < _WORTHLESS
        and np.linalg.eigvalsh(matrix)[0] >= -1e-9 * np.abs(matrix).max()
    )


def _assumed_covariance(depth, focal_length) -> np.ndarray:
    """Returns that of a marker's pose in the camera from its depth (m) alone, (6, 6)."""
    angle = _CORNER / focal_length
    across, along = depth * angle, depth**2 * angle / MARKER_SIZE
    turn = depth * angle / MARKER_SIZE
    # A board that is seen head-on hardly shows that it turns.
    return np.diag([4 * turn, 4 * turn, turn, across, across, along]) ** 2
