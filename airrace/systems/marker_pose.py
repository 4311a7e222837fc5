"""Poses of markers and gates from the corners of marker squares."""

import dataclasses as dc

import cv2
import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from airrace.immutable import read_only
from airrace.systems.types import CameraInfo, Detection
from airrace.track import MARKER_SIZE

GATE_SPACING = 10.0  # m, between the axes of a gate's pylons, by the rules
# A gate is not as the rules say if the corners are this many standard deviations
# (root mean square) off the joint pose.
_MISFIT = 3.0
# The marker's corners in a frame F that is M turned half a turn about x: a
# marker that faces the camera then has no rotation.
_H = MARKER_SIZE / 2
_POINTS = np.array([[-_H, -_H, 0.0], [_H, -_H, 0.0], [_H, _H, 0.0], [-_H, _H, 0.0]])
_R_FM = RotationMatrix(np.diag([1.0, -1.0, -1.0]))
_TILT = 0.4  # rad
_MAX_ITERATIONS = 20
_CONVERGED = 1e-4  # squared standard deviations, of a step
_HOPELESS = 100.0  # times the cost of a better pose
_ZERO, _EYE = np.zeros(3), np.eye(6)


@dc.dataclass(frozen=True)
class _Pose:
    """A pose of F in the camera frame, and how well it fits.

    Attributes:
        R, t: R_CF, (3, 3), and p_CF (m), (3,).
        cost: squared standard deviations between corners and projections.
        residual: corners less projections, (2 n,) px.
        covariance: of rotation vector in C (rad) and position in C (m), (6, 6).
        ambiguity: see Detection.
    """

    R: np.ndarray
    t: np.ndarray
    cost: float
    residual: np.ndarray
    covariance: np.ndarray
    ambiguity: float = 0.0

    @property
    def error(self) -> float:
        """RMS distance between corners and projections (px)."""
        return float(np.sqrt(2 * np.mean(self.residual**2)))


def locate(id: int, corners, covariance, info: CameraInfo) -> Detection | None:
    """Solves the pose of one marker from its corners.

    Args:
        id: the marker's ID.
        corners: (4, 2) px; top left, top right, bottom right, bottom left.
        covariance: of the corners x0, y0, x1, ..., (8, 8) px^2.
        info: the camera.

    Returns:
        the detection, or None if there is no pose in front of the camera.
    """
    if not np.ptp(corners, axis=0).max() > 0:  # nor if it is not finite
        return None
    pose = _solve(_POINTS, corners, np.linalg.inv(covariance), info)
    return None if pose is None else _detection(id, corners, pose)


def locate_gate(ids, corners, covariances, info: CameraInfo) -> dict:
    """Solves the pose of one face of a gate from its two markers.

    Both boards lie in one plane, upright, a known distance apart: one rigid
    body of eight points.

    Args:
        ids: of the left and the right pylon's marker, of the same face.
        corners, covariances: see locate(); one each.
        info: the camera.

    Returns:
        ID to Detection of both, or of none if the corners deny that distance.
    """
    if not np.ptp(corners, axis=1).max(axis=1).min() > 0:
        return {}
    # From behind, the left pylon is on the right.
    offset = np.array([-GATE_SPACING if ids[0] % 2 else GATE_SPACING, 0.0, 0.0])
    points = np.concatenate([_POINTS - offset / 2, _POINTS + offset / 2])
    information = np.zeros((16, 16))
    information[:8, :8], information[8:, 8:] = np.linalg.inv(covariances)
    pose = _solve(points, np.concatenate(corners), information, info)
    if pose is None or pose.cost > _MISFIT**2 * len(information):
        return {}
    return {
        id: _detection(id, quad, _shifted(pose, side * offset / 2, residual), joint=True)
        for id, quad, side, residual in zip(
            ids, corners, (-1, 1), np.split(pose.residual, 2))
    }


def _solve(points, corners, information, info: CameraInfo) -> _Pose | None:
    """Returns the best pose of points in a plane, None if there is none.

    The seeds are the two solutions of Collins and Bartoli, "Infinitesimal
    plane-based pose estimation", IJCV 2014 (OpenCV's SOLVEPNP_IPPE).
    """
    _, rotations, translations, _ = cv2.solvePnPGeneric(
        points, corners, info.K, info.D, flags=cv2.SOLVEPNP_IPPE
    )
    seeds = [
        (cv2.Rodrigues(r)[0], t[:, 0]) for r, t in zip(rotations, translations)
        if np.isfinite(r).all() and np.isfinite(t).all() and t[2, 0] > 0
    ]
    best, others = None, []
    for R, t in seeds or _guesses(points, corners, info):
        pose = _refine(points, corners, information, info, R, t, best)
        if pose is None:
            continue
        if best is None or pose.cost < best.cost:
            best, pose = pose, best
        if pose is not None and np.trace(pose.R.T @ best.R) < 3 - 1e-4:  # 0.01 rad
            others.append(pose.cost)
    if others:
        best = dc.replace(best, ambiguity=float(np.sqrt(best.cost / max(min(others), 1e-12))))
    return best


def _refine(points, corners, information, info: CameraInfo, R, t, best) -> _Pose | None:
    """Minimises the weighted reprojection error (Levenberg-Marquardt).

    The covariance is the inverse of the normal matrix J^T W J at the minimum.

    Args:
        points: in F, (n, 3) m.
        corners: where they are seen, (n, 2) px.
        information: inverse of the corners' covariance W, (2 n, 2 n).
        info: the camera.
        R, t: pose to start from.
        best: a pose so good that hopeless starts can be left out, or None.

    Returns:
        None if there is no minimum, or no hope, or it is behind the camera.
    """

    def linearized(R, t):
        # About points already turned, OpenCV's derivatives by the rotation
        # vector are those by a small rotation in C.
        pixels, J, *_ = cv2.projectPoints(points @ R.T, _ZERO, t, info.K, info.D)
        residual = (corners - pixels[:, 0]).ravel()
        weighted = J[:, :6].T @ information
        return residual, weighted @ J[:, :6], weighted @ residual, residual @ information @ residual

    residual, H, g, cost = linearized(R, t)
    if best is not None and cost > _HOPELESS * (best.cost + len(residual)):
        return None
    damping = 1e-6
    for _ in range(_MAX_ITERATIONS):
        step = np.linalg.solve(H + damping * H * _EYE, g)
        R_new, t_new = cv2.Rodrigues(step[:3])[0] @ R, t + step[3:]
        trial = linearized(R_new, t_new)
        if not trial[3] <= cost + _CONVERGED:
            damping *= 100.0
            continue
        R, t, damping = R_new, t_new, damping / 10
        residual, H, g, cost = trial
        if damping < 1.0 and step @ H @ step < _CONVERGED:
            break
    if not (np.isfinite(cost) and np.all((points @ R.T + t)[:, 2] > 0)):
        return None
    return _Pose(R, t, float(cost), residual, np.linalg.inv(H))


def _guesses(points, corners, info: CameraInfo):
    """Returns rough poses, for views of perfect symmetry where IPPE finds none."""
    depth = np.ptp(points, axis=0).max() * info.K[0, 0] / np.ptp(corners, axis=0).max()
    t = depth * np.linalg.solve(info.K, [*corners.mean(axis=0), 1.0])
    return [
        (cv2.Rodrigues(np.array([a, b, 0.0]))[0], t)
        for a, b in ((_TILT, 0), (-_TILT, 0), (0, _TILT), (0, -_TILT))
    ]


def _shifted(pose: _Pose, p_F, residual) -> _Pose:
    """Returns the pose of a frame that is carried along at p_F in F."""
    x, y, z = p_C = pose.R @ p_F
    transport = np.eye(6)
    transport[3:, :3] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]  # w x p_C
    return dc.replace(
        pose, t=pose.t + p_C, residual=residual,
        covariance=transport @ pose.covariance @ transport.T,
    )


def _detection(id, corners, pose: _Pose, joint=False) -> Detection:
    # A rotation matrix from OpenCV is not orthonormal enough for Drake.
    R_CF = RotationMatrix.ProjectToRotationMatrix(pose.R)
    return Detection(
        id=id,
        corners=read_only(corners),
        X_CM=RigidTransform(R_CF @ _R_FM, pose.t),
        reprojection_error=pose.error,
        covariance=read_only(pose.covariance),
        joint=joint,
        ambiguity=pose.ambiguity,
    )
