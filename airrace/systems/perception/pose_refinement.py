"""Minimises the reprojection errors of marker corners, weighted by their covariance."""

import math
import typing

import numpy as np

from airrace.common.jit import compiled
from airrace.math.small_matrices import (
    apply,
    cholesky,
    inverse,
    product,
    propagated,
    skew,
    solve_cholesky,
)
from airrace.math.vec3 import dot, rotate

_MAX_ITERATIONS = 20
_CONVERGED = 1e-4  # squared standard deviations, of a step
_MOST_COST = 100.0  # times the cost of a better pose, of one to start from
_SAME = 3 - 1e-4  # trace of the rotation from one pose to another: 0.01 rad


class Pose(typing.NamedTuple):
    """A pose of a frame F in the camera frame, and how well it fits."""

    #: R, t: R_CF, (3, 3), and p_CF (m), (3,)
    R: np.ndarray
    t: np.ndarray
    #: Squared standard deviations between corners and projections; NaN if there is no pose in front
    #: of the camera.
    cost: float
    residual: np.ndarray  #: corners less projections, (4 m, 2) px
    covariance: np.ndarray  #: of rotation vector in C (rad) and position in C (m), (6, 6)
    ambiguity: float  #: see Detection


class _Problem(typing.NamedTuple):
    """What is minimised: r^T W r of the residual r, corners less projections.

    Attributes:
        points, corners, camera: see best_pose().
        weights: inverses W of the corners' covariances, (m, 8, 8).
    """

    points: np.ndarray
    corners: np.ndarray
    weights: np.ndarray
    camera: np.ndarray


@compiled
def best_pose(
    points: np.ndarray,
    corners: np.ndarray,
    covariances: np.ndarray,
    camera: np.ndarray,
    seeds: np.ndarray,
) -> Pose:
    """Returns the best Pose from several to start from.

    Args:
        points: corners of m markers in F, (4 m, 3) m.
        corners: where they are seen, (4 m, 2) px.
        covariances: of each marker's corners x0, y0, x1, ..., (m, 8, 8) px^2.
        camera: fx, fy, cx, cy, k1, k2, p1, p2, k3, (9,).
        seeds: rotation vectors (rad) and positions (m) of F in C, (n, 6).
    """
    weights = np.empty_like(covariances)
    for m in range(len(covariances)):
        weights[m] = inverse(covariances[m])
    problem = _Problem(points, corners, weights, camera)
    best = Pose(np.eye(3), np.zeros(3), np.nan, corners, np.zeros((6, 6)), 0.0)
    other = np.inf  # the cost of the best pose that is really another
    for seed in seeds:
        limit = np.inf if math.isnan(best.cost) else _MOST_COST * (best.cost + corners.size)
        pose = _refined(problem, rotation(seed[:3]), seed[3:].copy(), limit)
        if math.isnan(pose.cost):
            continue
        if not pose.cost >= best.cost:
            best, pose = pose, best
        if not math.isnan(pose.cost) and np.sum(pose.R * best.R) < _SAME:
            other = min(other, pose.cost)
    ambiguity = math.sqrt(best.cost / max(other, 1e-12))
    return Pose(best.R, best.t, best.cost, best.residual, best.covariance, ambiguity)


@compiled
def pose_at(pose: Pose, p: np.ndarray) -> Pose:
    """Returns the Pose of a frame that is fixed to F, at p in F with its axes; (3,) m."""
    q = rotate(pose.R, p)
    J = np.eye(6)
    J[3:, :3] = -skew(q)  # it moves by w x q when F rotates by w
    covariance = propagated(J, pose.covariance)
    return Pose(pose.R, pose.t + q, pose.cost, pose.residual, covariance, pose.ambiguity)


@compiled
def _refined(problem, R, t, limit):
    """Minimises the cost from a pose R, t by Levenberg-Marquardt, unless it exceeds a limit there.

    The covariance is the inverse of J^T W J at the minimum.
    """
    residual, H, g, cost = _linearized(problem, R, t)
    if cost > limit:
        return Pose(R, t, np.nan, residual, H, 0.0)
    damping = 1e-6
    for _ in range(_MAX_ITERATIONS):
        step = solve_cholesky(cholesky(H + damping * np.diag(np.diag(H))), g)
        R_new, t_new = product(rotation(step[:3]), R), t + step[3:]
        trial = _linearized(problem, R_new, t_new)
        if not trial[3] <= cost + _CONVERGED:
            damping *= 100.0
            continue
        R, t, damping = R_new, t_new, damping / 10
        residual, H, g, cost = trial
        if damping < 1.0 and np.sum(step * apply(H, step)) < _CONVERGED:
            break
    if not np.all(apply(problem.points, R[2]) + t[2] > 0.0):
        cost = np.nan
    return Pose(R, t, cost, residual, inverse(H), 0.0)


@compiled
def _linearized(problem, R, t):
    """Linearises the projection by a small rotation and shift of F, both in C.

    Returns:
        residual r, corners less projections, (4 m, 2); J^T W J, (6, 6); J^T W r,
        (6,); and r^T W r.
    """
    points, corners, weights, camera = problem
    residual, J = np.empty(corners.shape), np.empty((corners.size, 6))
    for k in range(len(points)):
        q = rotate(R, points[k])
        pixel, by_position = project(q + t, camera)
        residual[k] = corners[k] - pixel
        rows = slice(2 * k, 2 * k + 2)
        J[rows, :3] = product(by_position, -skew(q))  # a rotation w moves q by w x q
        J[rows, 3:] = by_position
    H, g, cost = np.zeros((6, 6)), np.zeros(6), 0.0
    for m in range(len(weights)):
        J_m, r_m = J[8 * m : 8 * m + 8], residual[4 * m : 4 * m + 4].ravel()
        weighted = product(weights[m], J_m)
        H += product(J_m.T, weighted)
        g += apply(weighted.T, r_m)
        cost += np.sum(r_m * apply(weights[m], r_m))
    return residual, H, g, cost


@compiled
def project(p: np.ndarray, camera: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the pixel of a point through a lens with plumb-bob distortion.

    Args: p: the point in C, (3,) m. camera: see best_pose().

    Returns: (2,) px, and its derivative by p, (2, 3).
    """
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = camera
    z = p[2]
    x, y = p[0] / z, p[1] / z
    s = x * x + y * y
    radial = 1 + s * (k1 + s * (k2 + s * k3))
    by_s = k1 + s * (2 * k2 + s * 3 * k3)
    u = x * radial + 2 * p1 * x * y + p2 * (s + 2 * x * x)
    v = y * radial + p1 * (s + 2 * y * y) + 2 * p2 * x * y
    across = 2 * x * y * by_s + 2 * p1 * x + 2 * p2 * y
    u_x = fx * (radial + 2 * x * x * by_s + 2 * p1 * y + 6 * p2 * x)
    v_y = fy * (radial + 2 * y * y * by_s + 6 * p1 * y + 2 * p2 * x)
    u_y, v_x = fx * across, fy * across
    u_z, v_z = -(u_x * x + u_y * y), -(v_x * x + v_y * y)
    by_p = np.array(((u_x / z, u_y / z, u_z / z), (v_x / z, v_y / z, v_z / z)))
    return np.array((fx * u + cx, fy * v + cy)), by_p


@compiled
def rotation(vector: np.ndarray) -> np.ndarray:
    """Returns the rotation matrix of a rotation vector (rad), (3, 3) (Rodrigues)."""
    angle = math.sqrt(dot(vector, vector))
    s = math.sin(angle) / angle if angle > 1e-9 else 1.0
    c = 0.5 * (math.sin(angle / 2) / (angle / 2)) ** 2 if angle > 1e-9 else 0.5
    K = skew(vector)
    return np.eye(3) + s * K + c * product(K, K)
