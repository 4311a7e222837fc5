"""Errors of attitude for controllers."""

import math

import numpy as np

from airrace.common.jit import compilable
from airrace.math.vec3 import cross, dot

_UP = np.array((0.0, 0.0, 1.0))


@compilable
def reduced_error(R_DB: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Returns the error e_R of the body's attitude from the desired one, in B, (3,).

    The tilt of the thrust axis and the yaw are separated, as by Brescianini
    and D'Andrea, "Tilt-prioritized quadrocopter attitude control" (IEEE T-CST
    2020), so that a large error in yaw, which multirotors correct slowly,
    does not change the direction in which the tilt is corrected. To first order
    it is lee_error().

    Args: R_DB: R_WD^T R_WB, (3, 3). w: angular velocity in B (rad/s), (3,), see tilt_error().
    """
    # The last row of R_DB is the desired z axis in B.
    x, y, _ = tilt_error(R_DB[2], _UP, w)
    yaw = math.atan2(R_DB[1, 0] - R_DB[0, 1], R_DB[0, 0] + R_DB[1, 1])
    return np.array((x, y, 2.0 * math.sin(yaw / 2)))


@compilable
def lee_error(R_DB: np.ndarray) -> np.ndarray:
    """Returns the error e_R of the body's attitude from the desired one, in B, (3,).

    It is 1/2 (R_d^T R - R^T R_d)^vee, equation (10) of Lee, Leok, McClamroch (CDC
    2010): the sine of the angle, about the axis of the rotation. So it grows up to 90
    degrees only, and vanishes at half a turn.

    Args: R_DB: R_d^T R, that is R_WD^T R_WB, (3, 3).
    """
    S = R_DB
    return 0.5 * np.array((S[2, 1] - S[1, 2], S[0, 2] - S[2, 0], S[1, 0] - S[0, 1]))


@compilable
def tilt_error(n_d: np.ndarray, n: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Returns 2 sin(angle / 2) about the axis that turned n_d into n, (3,).

    It grows all the way to half a turn, as in Lee, "Geometric tracking control
    of the attitude dynamics of a rigid body on SO(3)" (ACC 2011), equation (10);
    n_d x n, sin(angle), would vanish there, and leave an inverted drone inverted.
    At half a turn every axis across n is right: the drone's own turn goes on, and
    at rest any axis is taken.

    Args:
        n_d: unit vector in B that should be at n, (3,).
        n: unit vector fixed in B, (3,).
        w: angular velocity in B (rad/s), (3,).
    """
    half_cosine = math.sqrt(max(0.5 + 0.5 * dot(n_d, n), 0.0))
    if half_cosine > 1e-3:
        return cross(n_d, n) / half_cosine
    axis = dot(w, n) * n - w
    if dot(axis, axis) < 1e-6:
        least = np.zeros(3)
        least[np.argmin(np.abs(n))] = 1.0
        axis = cross(n, least)
    return 2.0 / math.sqrt(dot(axis, axis)) * axis


@compilable
def lead_moment(moment: np.ndarray, angle: float) -> np.ndarray:
    """Returns a moment turned by -angle about z, (3,).

    The rotors of a spinning body answer late, in a direction that has turned with
    the body by then; this compensates for it.
    """
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = moment
    return np.array((c * x + s * y, c * y - s * x, z))
