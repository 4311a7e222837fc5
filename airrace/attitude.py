"""Errors of attitude for controllers, and rotations fast enough for their loops."""

import math

import numpy as np

from airrace import triples


def attitude_error(E, w) -> np.ndarray:
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
    e = tilt_error(E[2], _Z, w)  # the last row of E is the desired z axis in B
    yaw = math.atan2(E[1][0] - E[0][1], E[0][0] + E[1][1])
    e[2] = 2.0 * math.sin(yaw / 2)
    return e


def tilt_error(n_d, n, w) -> np.ndarray:
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
    cosine = math.sqrt(max(0.5 + 0.5 * triples.dot(n_d, n), 0.0))  # of half the angle
    if cosine > 1e-3:
        return np.array(triples.cross(n_d, n)) / cosine
    # The way on, and if at rest, across n.
    n, w = np.array(n), np.array(w)
    axis = -(w - w.dot(n) * n)
    if axis.dot(axis) < 1e-6:
        axis = cross(n, np.eye(3)[np.abs(n).argmin()])
    return 2.0 / math.sqrt(axis.dot(axis)) * axis


def turned_back(moment, angle: float) -> np.ndarray:
    """Returns a moment turned by -angle about z, (3,).

    What the rotors of a spinning body do late, they do in a direction that has
    turned with the body; this makes up for it.
    """
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = moment
    return np.array([c * x + s * y, c * y - s * x, z])


def cross(a, b) -> np.ndarray:
    """Returns a x b; numpy's own costs ten times as much on a single pair."""
    return np.array(triples.cross(a.tolist(), b.tolist()))


def rotation_matrix(w, x, y, z) -> np.ndarray:
    """Returns the rotation matrix (3, 3) of a quaternion of any length."""
    return np.array(triples.columns(w, x, y, z)).T


_Z = (0.0, 0.0, 1.0)
