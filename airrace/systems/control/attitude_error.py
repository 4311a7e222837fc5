"""Errors of attitude for controllers, and rotations fast enough for their loops."""

import math

import numpy as np

from airrace.common.jit import compilable
from airrace.math import vec3


@compilable
def attitude_error(E, w) -> tuple:
    """Returns the error vector e_R of a relative attitude, in B, (3,).

    The tilt of the thrust axis and the yaw are told apart, as by Brescianini
    and D'Andrea, "Tilt-prioritized quadrocopter attitude control" (IEEE T-CST
    2020), so that a large error in yaw, which multirotors are slow to mend,
    does not turn the correction of the tilt aside. To first order it is
    equation (19) of Lee, Leok, McClamroch (CDC 2010).

    Args:
        E: R_d^T R, (3, 3), an array or its rows.
        w: angular velocity in B, see tilt_error().
    """
    # The last row of E is the desired z axis in B.
    x, y, _ = tilt_error(E[2], (0.0, 0.0, 1.0), w)
    yaw = math.atan2(E[1][0] - E[0][1], E[0][0] + E[1][1])
    return x, y, 2.0 * math.sin(yaw / 2)


@compilable
def tilt_error(n_d, n, w) -> tuple:
    """Returns 2 sin(angle / 2) about the axis that turned n_d into n, (3,).

    It grows all the way to half a turn, as in Lee, "Geometric tracking control
    of the attitude dynamics of a rigid body on SO(3)" (ACC 2011), equation (10);
    n_d x n, sin(angle), would vanish there, and leave an inverted drone inverted.
    At half a turn any axis will do: the one it is turning about already.

    Args:
        n_d: unit vector in B that should be at n, (3,).
        n: unit vector fixed in B, (3,).
        w: angular velocity in B, (3,).
    """
    cosine = math.sqrt(max(0.5 + 0.5 * vec3.dot(n_d, n), 0.0))  # of half the angle
    if cosine > 1e-3:
        x, y, z = vec3.cross(n_d, n)
        return x / cosine, y / cosine, z / cosine
    # The way on, and if at rest, across n.
    axis = vec3.sum2(vec3.dot(w, n), n, -1.0, w)
    if vec3.dot(axis, axis) < 1e-6:
        if abs(n[0]) <= abs(n[1]) and abs(n[0]) <= abs(n[2]):
            axis = vec3.cross(n, (1.0, 0.0, 0.0))
        elif abs(n[1]) <= abs(n[2]):
            axis = vec3.cross(n, (0.0, 1.0, 0.0))
        else:
            axis = vec3.cross(n, (0.0, 0.0, 1.0))
    scale = 2.0 / math.sqrt(vec3.dot(axis, axis))
    return scale * axis[0], scale * axis[1], scale * axis[2]


@compilable
def turned_back(moment, angle: float) -> tuple:
    """Returns a moment turned by -angle about z, (3,).

    What the rotors of a spinning body do late, they do in a direction that has
    turned with the body; this makes up for it.
    """
    c, s = math.cos(angle), math.sin(angle)
    return c * moment[0] + s * moment[1], c * moment[1] - s * moment[0], moment[2]


def cross(a, b) -> np.ndarray:
    """Returns a x b; numpy's own costs ten times as much on a single pair."""
    return np.array(vec3.cross(a.tolist(), b.tolist()))


def rotation_matrix(w, x, y, z) -> np.ndarray:
    """Returns the rotation matrix (3, 3) of a quaternion of any length."""
    return np.array(vec3.columns(w, x, y, z)).T
