"""An information filter on the pose of a rigid gate: in machine code, see compiled.py.

The pose of a gate is x, y, z of its midpoint at the boards' height (m), heading (rad),
spacing of its pylons (m). Pylons stand upright, so no more is free.
"""

import math

import numpy as np

from airrace.common.jit import compiled
from airrace.math.small_matrices import cholesky, inverse, solve_cholesky, transformed
from airrace.track import BOARD_OFFSET

X, Y, Z, HEADING, SPACING = range(5)
_HEADING_SIGMAS = 3.0  # beyond these, a normal is not believed
FLOOR = 0.03  # m, of a board's place in tests: errors that observations share
# What is known fades with time, so that the newest laps always count: variances.
_FADING = np.array([2e-4, 2e-4, 2e-4, 2e-5, 0.0]) ** 2  # m^2/s, rad^2/s


@compiled
def board_position(pose, id):
    """Returns where a board's centre is on a gate, and its derivative by the pose.

    Args:
        pose: of the gate, (5,).
        id: of the marker: 4n left front, 4n+1 left back, 4n+2 right front,
            4n+3 right back.

    Returns:
        (p_WM, J): (3,), (3, 5).
    """
    half = 0.5 if id & 2 else -0.5  # right, left
    side, out = half * pose[SPACING], BOARD_OFFSET * facing(id)
    c, s = math.cos(pose[HEADING]), math.sin(pose[HEADING])
    p_WM, J = np.empty(3), np.zeros((3, 5))
    p_WM[X] = pose[X] + out * c + side * s
    p_WM[Y] = pose[Y] + out * s - side * c
    p_WM[Z] = pose[Z]
    J[X, X] = J[Y, Y] = J[Z, Z] = 1.0
    J[X, HEADING], J[Y, HEADING] = -out * s + side * c, out * c + side * s
    J[X, SPACING], J[Y, SPACING] = half * s, -half * c
    return p_WM, J


@compiled
def facing(id):
    """Returns 1 if a board faces in the direction of flight, -1 if against it."""
    return 1 if id & 1 else -1


@compiled
def board(pose, covariance, id):
    """Returns the position of a board's centre, (3,), and its covariance, (3, 3).

    Args:
        pose, covariance: of the gate, (5,), (5, 5).
        id: of the marker.
    """
    p_WM, J = board_position(pose, id)
    return p_WM, transformed(J, covariance)


@compiled
def boards(pose, covariance, first):
    """Returns positions, their variances, and normals of a gate's boards, (3, 4, 3).

    Args:
        pose, covariance: see board().
        first: the lowest ID of the four.
    """
    result = np.zeros((3, 4, 3))
    for i in range(4):
        p_WM, variance = board(pose, covariance, first + i)
        for k in range(3):
            result[0, i, k], result[1, i, k] = p_WM[k], variance[k, k]
        result[2, i, 0] = facing(first + i) * math.cos(pose[HEADING])
        result[2, i, 1] = facing(first + i) * math.sin(pose[HEADING])
    return result


@compiled
def squared_distance(pose, covariance, id, p_WM, p_covariance):
    """Returns the square of the Mahalanobis distance of an observation from a gate's board.

    Args:
        pose, covariance, id: see board().
        p_WM, p_covariance: where the board was seen, (3,), (3, 3).
    """
    expected, variance = board(pose, covariance, id)
    for i in range(3):
        for j in range(3):
            variance[i, j] += p_covariance[i, j]
    return weighted_square(p_WM - expected, variance)


@compiled
def is_behind(pose, id, p_WM, p_WC, reach):
    """Whether a camera is on the wrong side of the face of a board that it claims to have seen.

    Args:
        pose: of the gate, (5,).
        id: of the marker.
        p_WM, p_WC: where the board was seen, and from where, (3,).
        reach: of what may be that board at all (m).
    """
    expected, _ = board_position(pose, id)
    x, y, z = p_WM - expected
    beyond = (p_WC[X] - expected[X]) * math.cos(pose[HEADING]) + (p_WC[Y] - expected[Y]) * math.sin(
        pose[HEADING]
    )
    return math.sqrt(x * x + y * y + z * z) < reach and facing(id) * beyond < 0.0


@compiled
def weighted_square(error, covariance):
    """Returns e^T (C + floor)^-1 e.

    Args:
        error: of a position (m), (3,).
        covariance: of that, (3, 3), without the errors that observations share.
    """
    total = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            total[i, j] = covariance[i, j] + (FLOOR**2 if i == j else 0.0)
    solution = solve_cholesky(cholesky(total), error)
    return error[0] * solution[0] + error[1] * solution[1] + error[2] * solution[2]


@compiled
def information(pose, id, p_WM, p_covariance, heading, heading_variance):
    """Returns what an observation says about a gate: J^T R^-1 J, (5, 5), and J^T R^-1 error, (5,).

    Args:
        pose: of the gate, (5,).
        id, p_WM, p_covariance, heading_variance: see Observation.
        heading: of the gate by the board's normal (rad).
    """
    expected, J = board_position(pose, id)
    weight = inverse(p_covariance)
    gain, error = np.zeros((5, 5)), np.zeros(5)
    for i in range(3):
        for j in range(3):
            for m in range(5):
                weighted = J[i, m] * weight[i, j]
                error[m] += weighted * (p_WM[j] - expected[j])
                for n in range(5):
                    gain[m, n] += weighted * J[j, n]
    turn = turn_between(heading, pose[HEADING])
    # Of two poses that a square admits, the detector may have taken the wrong one.
    if turn**2 < _HEADING_SIGMAS**2 * heading_variance:
        gain[HEADING, HEADING] += 1 / heading_variance
        error[HEADING] += turn / heading_variance
    return gain, error


@compiled
def turn_between(heading, other):
    """Returns the first heading less the other (rad), in [-pi, pi)."""
    return (heading - other + math.pi) % (2 * math.pi) - math.pi


@compiled
def updated(pose, covariance, elapsed, weight, id, p_WM, p_covariance, heading, heading_variance):
    """Returns pose and covariance after one more observation (extended Kalman filter).

    Args:
        pose, covariance: before, (5,), (5, 5).
        elapsed: time since the observation before (s).
        weight: how much of the observation's information is new, 0 to 1.
        id, p_WM, p_covariance, heading, heading_variance: see information().
    """
    faded = covariance.copy()
    for k in range(5):
        faded[k, k] += _FADING[k] * max(elapsed, 0.0)
    gain, error = information(pose, id, p_WM, p_covariance, heading, heading_variance)
    for i in range(5):
        error[i] *= weight
        for j in range(5):
            gain[i, j] *= weight
    return improved(pose, faded, gain, error)


@compiled
def improved(pose, covariance, gain, error):
    """Returns pose and covariance with what is new.

    Args:
        pose, covariance: before, (5,), (5, 5).
        gain, error: J^T R^-1 J, (5, 5), and J^T R^-1 error, (5,), of what is new.
    """
    total, better = inverse(covariance), pose.copy()
    for i in range(5):
        for j in range(5):
            total[i, j] += gain[i, j]
    after = inverse(total)
    for i in range(5):
        for j in range(5):
            better[i] += after[i, j] * error[j]
    return better, after


@compiled
def is_below(covariance, variance):
    """Whether no direction has a variance as large as this: v I - C is positive definite.

    Args:
        covariance: (n, n); what counts are its first three rows and columns.
        variance: (m^2).
    """
    rest = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            rest[i, j] = (variance if i == j else 0.0) - covariance[i, j]
    return not math.isnan(cholesky(rest)[2, 2])
