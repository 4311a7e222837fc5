"""Differential flatness: from position and yaw to attitude, rates and rotors."""

import numpy as np

from airrace.trajopt.flat_trajectory import ACCELERATION, JERK, SNAP, YAW
from airrace.triples import cross, dot, sum2, sum3


def _unit(n, dn, ddn):
    """Returns n / |n| and its first two derivatives, given those of n."""
    length = dot(n, n) ** 0.5
    scale = 1 / length
    u = (scale * n[0], scale * n[1], scale * n[2])
    rate = dot(u, dn)
    du = sum2(scale, dn, -rate / length, u)
    ddu = sum3(scale, ddn, -(dot(du, dn) + dot(u, ddn)) / length, u, -2 * rate / length, du)
    return u, du, ddu


def attitude_from_force(force, force_rate, force_acceleration, heading):
    """Returns the attitude that thrusts along a force and faces a heading.

    The body's z axis is along the force and its x axis in the plane of force
    and heading, as in Lee, Leok, McClamroch (CDC 2010), equation (23); the
    derivatives follow from differentiating that construction twice.

    Every vector is a tuple of three components, each a float or an array of
    samples: floats make this fast enough for a control loop, arrays check a
    whole trajectory at once.

    Args:
        force: specific force a + g e_z that the rotors must produce (m/s^2).
        force_rate, force_acceleration: its derivatives.
        heading: triple of the horizontal unit vector along the yaw and its
            first two derivatives, each a vector.

    Returns:
        (axes, w, alpha): body axes x, y, z in the world (the columns of
        R_WB); angular velocity (rad/s) and acceleration (rad/s^2), in B.
    """
    b3, db3, ddb3 = _unit(force, force_rate, force_acceleration)
    h, dh, ddh = heading
    b2, db2, ddb2 = _unit(
        cross(b3, h),
        sum2(1.0, cross(db3, h), 1.0, cross(b3, dh)),
        sum3(1.0, cross(ddb3, h), 2.0, cross(db3, dh), 1.0, cross(b3, ddh)),
    )
    b1 = cross(b2, b3)
    db1 = sum2(1.0, cross(db2, b3), 1.0, cross(b2, db3))
    # The entries of R^T dR and of its derivative R^T ddR + dR^T dR.
    w = (dot(b3, db2), dot(b1, db3), dot(b2, db1))
    alpha = (
        dot(b3, ddb2) + dot(db3, db2),
        dot(b1, ddb3) + dot(db1, db3),
        -(dot(b1, ddb2) + dot(db1, db2)),
    )
    return (b1, b2, b3), w, alpha


def heading_vectors(cos_yaw, sin_yaw, yaw_rate, yaw_acceleration):
    """Returns the heading and its two derivatives for attitude_from_force."""
    zero = 0.0 * cos_yaw
    h = (cos_yaw, sin_yaw, zero)
    left = (-sin_yaw, cos_yaw, zero)
    dh = (yaw_rate * left[0], yaw_rate * left[1], zero)
    ddh = sum2(yaw_acceleration, left, -yaw_rate * yaw_rate, h)
    return h, dh, ddh


def rotor_thrusts(flat_outputs, vehicle, gravity) -> np.ndarray:
    """Inverse dynamics of a trajectory, without drag.

    Args:
        flat_outputs: samples as in flat_trajectory.py, shape (18, N).
        vehicle: the airrace.vehicle.Vehicle.
        gravity: (m/s^2).

    Returns:
        thrust of every rotor (N), shape (n, N), by the pseudo-inverse of the
        allocation; not clipped to the limits.
    """
    a, j, s = flat_outputs[ACCELERATION], flat_outputs[JERK], flat_outputs[SNAP]
    yaw, yaw_rate, yaw_acceleration = flat_outputs[YAW:]
    force = (a[0], a[1], a[2] + gravity)
    _, w, alpha = attitude_from_force(
        force, j, s, heading_vectors(np.cos(yaw), np.sin(yaw), yaw_rate, yaw_acceleration)
    )
    w, alpha, J = np.array(w), np.array(alpha), np.array(vehicle.inertia)[:, None]
    moment = J * alpha + np.cross(w, J * w, axis=0)
    thrust = vehicle.mass * np.sqrt(dot(force, force))
    return np.linalg.pinv(vehicle.allocation) @ np.vstack([thrust[None], moment])
