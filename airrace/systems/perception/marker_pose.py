"""Poses of markers and gates from the corners of marker squares."""

import functools
import math
from collections.abc import Sequence

import cv2
import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from airrace.common.immutable import read_only
from airrace.systems.perception.pose_refinement import Pose, best_pose, pose_at
from airrace.systems.types import Detection
from airrace.track import MARKER_SIZE
from airrace.vehicle.camera_info import CameraInfo

GATE_SPACING = 10.0  # m, between the axes of a gate's pylons, by the rules
CORNER_SIGMA = 0.3  # px, of corners whose covariance is not known
# A gate does not have that spacing if the corners are this many standard deviations
# (root mean square) off the joint pose.
_MISFIT = 3.0
# The marker's corners in a frame F, which is M rotated by half a turn about x: a
# marker that faces the camera then has no rotation.
_H = MARKER_SIZE / 2
_POINTS = np.array([[-_H, -_H, 0.0], [_H, -_H, 0.0], [_H, _H, 0.0], [-_H, _H, 0.0]])
_SQUARE = _POINTS @ np.diag([1.0, -1.0, -1.0])  # in M itself, as OpenCV wants a square
_TO_RIGHT = np.array([GATE_SPACING / 2, 0.0, 0.0])
_GATE_POINTS = np.concatenate([_POINTS - _TO_RIGHT, _POINTS + _TO_RIGHT])
_R_FM = RotationMatrix(np.diag([1.0, -1.0, -1.0]))
_TILT = 0.4  # rad
_MOST_RESIDUAL = 0.05  # of the corners' extent: a pose with more is none


def locate(
    id: int, corners: np.ndarray, covariance: np.ndarray, info: CameraInfo
) -> Detection | None:
    """Solves the pose of one marker from its corners.

    Args:
        id: the marker's ID.
        corners: (4, 2) px; top left, top right, bottom right, bottom left.
        covariance: of the corners x0, y0, x1, ..., (8, 8) px^2.
        info: the camera.

    Returns: the detection, or None if there is no pose in front of the camera.
    """
    if not _is_extended(corners):
        return None
    pose = _solve(_POINTS, corners, covariance[None], info)
    return None if pose is None else _detection(id, corners, covariance, pose, pose.residual)


def locate_alone(id: int, corners: np.ndarray, info: CameraInfo) -> Detection | None:
    """Solves the pose of one marker as OpenCV does, in closed form and without a refinement.

    Of the two solutions of Collins and Bartoli (OpenCV's SOLVEPNP_IPPE_SQUARE) it is the one
    with the smaller reprojection error. The covariance is an assumed one.

    OpenCV returns rotations as vectors, which it computes wrongly where the angle is within
    rounding of pi. That takes corners of perfect symmetry, so no camera sees it; there is no
    pose then.

    Args: id, corners, info: see locate().

    Returns: as locate().
    """
    if not _is_extended(corners):
        return None
    _, turns, positions, errors = cv2.solvePnPGeneric(
        _SQUARE, corners, info.K, info.D, flags=cv2.SOLVEPNP_IPPE_SQUARE
    )
    if not turns or not np.isfinite([turns[0], positions[0]]).all() or positions[0][2] <= 0.0:
        return None
    R_CM, p_CM, errors = cv2.Rodrigues(turns[0])[0], positions[0].ravel(), np.ravel(errors)
    if not errors[0] < _MOST_RESIDUAL * np.ptp(corners):
        return None
    return Detection(
        id=id,
        corners=read_only(corners),
        X_CM=RigidTransform(RotationMatrix.ProjectToRotationMatrix(R_CM), p_CM),
        # OpenCV's is the root mean square of coordinates, not of distances.
        reprojection_error=float(math.sqrt(2.0) * errors[0]),
        covariance=read_only(assumed_covariance(p_CM[2], info.K[0, 0])),
        ambiguity=min(float(errors[0] / max(errors[-1], 1e-12)), 1.0) if len(errors) > 1 else 0.0,
        corner_sigma=CORNER_SIGMA,
    )


def locate_gate(
    ids: Sequence[int],
    corners: Sequence[np.ndarray],
    covariances: Sequence[np.ndarray],
    info: CameraInfo,
) -> dict:
    """Solves the pose of one face of a gate from its two markers.

    Both boards lie in one plane, upright, a known distance apart: one rigid
    body of eight points.

    Args:
        ids: of the left and the right pylon's marker, of the same face.
        corners, covariances: see locate(); one each.
        info: the camera.

    Returns: ID to Detection of both, or of none if the corners do not fit that distance.
    """
    if not all(map(_is_extended, corners)):
        return {}
    from_behind = ids[0] % 2  # the left pylon is then on the right
    order = slice(None, None, -1 if from_behind else 1)
    ids, corners, covariances = (
        ids[order],
        np.asarray(corners)[order],
        np.asarray(covariances)[order],
    )
    pose = _solve(_GATE_POINTS, corners.reshape(8, 2), covariances, info)
    if pose is None or pose.cost > _MISFIT**2 * corners.size:
        return {}
    return {
        id: _detection(id, quad, covariance, pose_at(pose, p_F), residual, joint=True)
        for id, quad, covariance, p_F, residual in zip(
            ids, corners, covariances, (-_TO_RIGHT, _TO_RIGHT), pose.residual.reshape(2, 4, 2)
        )
    }


def assumed_covariance(depth: float, focal_length: float) -> np.ndarray:
    """Returns that of a marker's pose in the camera from its depth alone, (6, 6).

    As of Detection; it is for corners with a standard deviation of CORNER_SIGMA.

    Args: depth: of the marker (m). focal_length: of the camera (px).
    """
    angle = CORNER_SIGMA / focal_length
    across, along = depth * angle, depth**2 * angle / MARKER_SIZE
    turn = depth * angle / MARKER_SIZE
    # Head-on, a rotation out of the image plane hardly moves the corners.
    return np.diag([4 * turn, 4 * turn, turn, across, across, along]) ** 2


def _is_extended(corners: np.ndarray) -> bool:
    """Whether corners are finite and not all in one place."""
    x, y = corners.T.tolist()
    return math.isfinite(sum(x) + sum(y)) and (max(x) > min(x) or max(y) > min(y))


def _solve(
    points: np.ndarray, corners: np.ndarray, covariances: np.ndarray, info: CameraInfo
) -> Pose | None:
    """Returns the best pose of points in a plane, None if there is none.

    The seeds are the two solutions of Collins and Bartoli, "Infinitesimal
    plane-based pose estimation", IJCV 2014 (OpenCV's SOLVEPNP_IPPE).
    """
    _, rotations, translations, _ = cv2.solvePnPGeneric(
        points, corners, info.K, info.D, flags=cv2.SOLVEPNP_IPPE
    )
    seeds = ([*r.ravel().tolist(), *t.ravel().tolist()] for r, t in zip(rotations, translations))
    seeds = [seed for seed in seeds if all(map(math.isfinite, seed)) and seed[5] > 0]
    seeds = np.array(seeds) if seeds else _guesses(points, corners, info)
    pose = best_pose(
        points,
        np.ascontiguousarray(corners, float),
        np.ascontiguousarray(covariances, float),
        intrinsics(info),
        seeds,
    )
    return pose if np.isfinite(pose.cost) else None


@functools.lru_cache(maxsize=4)
def intrinsics(info: CameraInfo) -> np.ndarray:
    """Returns fx, fy, cx, cy, k1, k2, p1, p2, k3 of a camera, (9,)."""
    return np.array([*info.K[[0, 1, 0, 1], [0, 1, 2, 2]], *info.D])


def _guesses(points: np.ndarray, corners: np.ndarray, info: CameraInfo) -> np.ndarray:
    """Returns rough poses, for views of perfect symmetry where IPPE finds none, (4, 6)."""
    depth = np.ptp(points, axis=0).max() * info.K[0, 0] / np.ptp(corners, axis=0).max()
    t = depth * np.linalg.solve(info.K, [*corners.mean(axis=0), 1.0])
    return np.array(
        [[a, b, 0.0, *t] for a, b in ((_TILT, 0), (-_TILT, 0), (0, _TILT), (0, -_TILT))]
    )


def _detection(
    id: int,
    corners: np.ndarray,
    covariance: np.ndarray,
    pose: Pose,
    residual: np.ndarray,
    joint: bool = False,
) -> Detection:
    # A rotation matrix from a product of others is not orthonormal enough for Drake.
    R_CF = RotationMatrix.ProjectToRotationMatrix(pose.R)
    return Detection(
        id=id,
        corners=read_only(corners),
        X_CM=RigidTransform(R_CF @ _R_FM, pose.t),
        reprojection_error=math.sqrt(np.vdot(residual, residual) / len(residual)),
        covariance=read_only(pose.covariance),
        joint=joint,
        ambiguity=pose.ambiguity,
        corner_sigma=math.sqrt(np.trace(covariance) / len(covariance)),
    )
