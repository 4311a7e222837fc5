"""Minimises reprojection errors of marker corners, in machine code, see compiled.py."""

import math
import typing

import numpy as np

from airrace.common.jit import compiled
from airrace.math.small_matrices import cholesky, inverse, solve_cholesky, transformed

_MAX_ITERATIONS = 20
_CONVERGED = 1e-4  # squared standard deviations, of a step
_HOPELESS = 100.0  # times the cost of a better pose
_SAME = 3 - 1e-4  # trace of the turn from one pose to another: 0.01 rad


class Pose(typing.NamedTuple):
    """A pose of a frame F in the camera frame, and how well it fits.

    Attributes:
        R, t: R_CF, (3, 3), and p_CF (m), (3,).
        cost: squared standard deviations between corners and projections; NaN
            if there is no pose in front of the camera.
        residual: corners less projections, (4 m, 2) px.
        covariance: of rotation vector in C (rad) and position in C (m), (6, 6).
        ambiguity: see Detection.
    """

    R: np.ndarray
    t: np.ndarray
    cost: float
    residual: np.ndarray
    covariance: np.ndarray
    ambiguity: float


@compiled
def best_pose(points, corners, covariances, camera, seeds):
    """Returns the best Pose from several to start from.

    Args:
        points: corners of m markers in F, (4 m, 3) m.
        corners: where they are seen, (4 m, 2) px.
        covariances: of each marker's corners x0, y0, x1, ..., (m, 8, 8) px^2.
        camera: fx, fy, cx, cy, k1, k2, p1, p2, k3, (9,).
        seeds: rotation vectors (rad) and positions (m) of F in C, (n, 6).
    """
    informations = np.empty_like(covariances)
    for m in range(len(covariances)):
        informations[m] = inverse(covariances[m])
    best = Pose(np.eye(3), np.zeros(3), np.nan, corners, np.zeros((6, 6)), 0.0)
    other = np.inf  # the cost of the best pose that is really another
    for k in range(len(seeds)):
        # What starts far above the best is not worth the time.
        limit = np.inf if math.isnan(best.cost) else _HOPELESS * (best.cost + corners.size)
        R, t = rotation(seeds[k, :3]), seeds[k, 3:].copy()
        pose = _refined(points, corners, informations, camera, R, t, limit)
        if math.isnan(pose.cost):
            continue
        if not pose.cost >= best.cost:
            best, pose = pose, best
        if not math.isnan(pose.cost) and np.sum(pose.R * best.R) < _SAME:
            other = min(other, pose.cost)
    return Pose(
        best.R,
        best.t,
        best.cost,
        best.residual,
        best.covariance,
        math.sqrt(best.cost / max(other, 1e-12)),
    )


@compiled
def carried_along(pose, p):
    """Returns the Pose of a frame that is carried along with F, at p in F; (3,) m."""
    x, y, z = _turned(pose.R, p)
    J = np.eye(6)  # it moves by w x p when F turns by w
    J[3, 1], J[3, 2], J[4, 2] = z, -y, x
    J[4, 0], J[5, 0], J[5, 1] = -z, y, -x
    t = np.empty(3)
    t[0], t[1], t[2] = pose.t[0] + x, pose.t[1] + y, pose.t[2] + z
    return Pose(
        pose.R, t, pose.cost, pose.residual, transformed(J, pose.covariance), pose.ambiguity
    )


@compiled
def _refined(points, corners, informations, camera, R, t, limit):
    """Minimises the weighted reprojection error (Levenberg-Marquardt).

    The covariance is the inverse of the normal matrix J^T W J at the minimum.

    Args:
        points, corners, camera: see best_pose().
        informations: inverses of the corners' covariances W, (m, 8, 8).
        R, t: pose to start from.
        limit: if it costs more than this, it is left alone.
    """
    residual, H, g, cost = _linearized(points, corners, informations, camera, R, t)
    if cost > limit:
        return Pose(R, t, np.nan, residual, H, 0.0)
    damping = 1e-6
    for _ in range(_MAX_ITERATIONS):
        damped = H.copy()
        for i in range(6):
            damped[i, i] *= 1 + damping
        step = solve_cholesky(cholesky(damped), g)
        R_new, t_new = _product(rotation(step[:3]), R), t + step[3:]
        trial = _linearized(points, corners, informations, camera, R_new, t_new)
        if not trial[3] <= cost + _CONVERGED:
            damping *= 100.0
            continue
        R, t, damping = R_new, t_new, damping / 10
        residual, H, g, cost = trial
        if damping < 1.0 and _square(H, step) < _CONVERGED:
            break
    for p in points:
        if not R[2, 0] * p[0] + R[2, 1] * p[1] + R[2, 2] * p[2] + t[2] > 0:
            cost = np.nan
    return Pose(R, t, cost, residual, inverse(H), 0.0)


@compiled
def _linearized(points, corners, informations, camera, R, t):
    """Linearises the projection by a small turn and shift of F, both in C.

    Returns:
        residual r, corners less projections, (4 m, 2); J^T W J, (6, 6); J^T W r,
        (6,); and r^T W r.
    """
    residual, J = np.empty(corners.shape), np.empty((corners.size, 6))
    for k in range(len(points)):
        pixel = _project(_turned(R, points[k]), t, camera, J[2 * k : 2 * k + 2])
        residual[k] = corners[k, 0] - pixel[0], corners[k, 1] - pixel[1]
    H, g, cost = np.zeros((6, 6)), np.zeros(6), 0.0
    r = residual.ravel()
    weighted = np.empty(6)  # a row of W J
    for m in range(len(informations)):
        for i in range(8):
            weighted[:], weighted_r = 0.0, 0.0
            for j in range(8):
                w, b = informations[m, i, j], 8 * m + j
                weighted_r += w * r[b]
                for u in range(6):
                    weighted[u] += w * J[b, u]
            a = 8 * m + i
            cost += r[a] * weighted_r
            for u in range(6):
                g[u] += J[a, u] * weighted_r
                for v in range(6):
                    H[u, v] += J[a, u] * weighted[v]
    return residual, H, g, cost


@compiled
def _project(q, t, camera, J):
    """Returns the pixel of a point through a lens with plumb-bob distortion.

    Args:
        q: from the origin of F to the point, in C, (3,) m.
        t: p_CF, (3,) m.
        camera: see best_pose().
        J: where to write the derivatives by a turn and a shift of F in C, (2, 6).
    """
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = camera
    z = q[2] + t[2]
    x, y = (q[0] + t[0]) / z, (q[1] + t[1]) / z
    s = x * x + y * y
    radial = 1 + s * (k1 + s * (k2 + s * k3))
    by_s = k1 + s * (2 * k2 + s * 3 * k3)
    u = x * radial + 2 * p1 * x * y + p2 * (s + 2 * x * x)
    v = y * radial + p1 * (s + 2 * y * y) + 2 * p2 * x * y
    across = 2 * x * y * by_s + 2 * p1 * x + 2 * p2 * y
    u_x = radial + 2 * x * x * by_s + 2 * p1 * y + 6 * p2 * x
    v_y = radial + 2 * y * y * by_s + 6 * p1 * y + 2 * p2 * x
    J[0, 3:] = fx * u_x / z, fx * across / z, -fx * (u_x * x + across * y) / z
    J[1, 3:] = fy * across / z, fy * v_y / z, -fy * (across * x + v_y * y) / z
    for i in range(2):  # a . (w x q) = w . (q x a)
        a, b, c = J[i, 3:]
        J[i, :3] = q[1] * c - q[2] * b, q[2] * a - q[0] * c, q[0] * b - q[1] * a
    return fx * u + cx, fy * v + cy


@compiled
def rotation(vector):
    """Returns the rotation matrix of a rotation vector (rad), (3, 3) (Rodrigues)."""
    x, y, z = vector
    angle = math.sqrt(x * x + y * y + z * z)
    # sin(a) / a and (1 - cos(a)) / a^2
    s = math.sin(angle) / angle if angle > 1e-9 else 1.0
    c = 0.5 * (math.sin(angle / 2) / (angle / 2)) ** 2 if angle > 1e-9 else 0.5
    w = 1 - c * angle * angle
    R = np.empty((3, 3))
    R[0] = w + c * x * x, c * x * y - s * z, c * x * z + s * y
    R[1] = c * x * y + s * z, w + c * y * y, c * y * z - s * x
    R[2] = c * x * z - s * y, c * y * z + s * x, w + c * z * z
    return R


@compiled
def _product(A, B):
    C = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            C[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]
    return C


@compiled
def _turned(R, p):
    return (
        R[0, 0] * p[0] + R[0, 1] * p[1] + R[0, 2] * p[2],
        R[1, 0] * p[0] + R[1, 1] * p[1] + R[1, 2] * p[2],
        R[2, 0] * p[0] + R[2, 1] * p[1] + R[2, 2] * p[2],
    )


@compiled
def _square(H, x):
    """Returns x^T H x."""
    total = 0.0
    for i in range(len(x)):
        for j in range(len(x)):
            total += x[i] * H[i, j] * x[j]
    return total
