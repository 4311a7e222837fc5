"""Differential flatness: from position and yaw to attitude, rates and rotors."""

import numpy as np

from airrace.common.jit import compilable
from airrace.math.vec3 import cross, dot
from airrace.trajopt.reference import as_reference
from airrace.vehicle import GRAVITY, Vehicle
from airrace.vehicle.air import STILL, Air

_SLOW = 0.1  # m/s, so that the amount of a velocity has derivatives at rest, too


@compilable
def unit_vector(
    n: np.ndarray, dn: np.ndarray, ddn: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns n / |n| and its first two derivatives, given those of n, (3,) or (3, N)."""
    length = np.sqrt(dot(n, n))
    scale = 1 / length
    u = scale * n
    rate = dot(u, dn)
    du = scale * dn + (-rate / length) * u
    ddu = scale * ddn + (-(dot(du, dn) + dot(u, ddn)) / length) * u + (-2 * rate / length) * du
    return u, du, ddu


@compilable
def attitude_from_force(
    force: np.ndarray, force_rate: np.ndarray, force_acceleration: np.ndarray, heading: tuple
) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], np.ndarray, np.ndarray]:
    """Returns the attitude that thrusts along a force and faces a heading.

    The body's z axis is along the force and its x axis in the plane of force
    and heading, as Lee, Leok, McClamroch (CDC 2010) make R_d of equation (12); the
    derivatives follow from differentiating that construction twice.

    All vectors are (3,), or (3, N) for N samples.

    Args:
        force: specific force a + g e_z that the rotors must produce (m/s^2).
        force_rate, force_acceleration: its derivatives.
        heading: the horizontal unit vector along the yaw and its
            first two derivatives, a tuple.

    Returns:
        (axes, w, alpha): body axes x, y, z in the world (the columns of
        R_WB); angular velocity (rad/s) and acceleration (rad/s^2), in B.
    """
    b3, db3, ddb3 = unit_vector(force, force_rate, force_acceleration)
    h, dh, ddh = heading
    b2, db2, ddb2 = unit_vector(
        cross(b3, h),
        cross(db3, h) + cross(b3, dh),
        cross(ddb3, h) + 2.0 * cross(db3, dh) + cross(b3, ddh),
    )
    b1 = cross(b2, b3)
    # The entries of R^T dR = [w]x and of R^T ddR = [alpha]x + [w]x [w]x.
    x, y, z = dot(b3, db2), dot(b1, db3), -dot(b1, db2)
    alpha = np.array((dot(b3, ddb2) - y * z, dot(b1, ddb3) - x * z, x * y - dot(b1, ddb2)))
    return (b1, b2, b3), np.array((x, y, z)), alpha


@compilable
def heading_vectors(
    cos_yaw: float | np.ndarray,
    sin_yaw: float | np.ndarray,
    yaw_rate: float | np.ndarray,
    yaw_acceleration: float | np.ndarray,
) -> tuple:
    """Returns the heading and its two derivatives, (x, y, z) each, for attitude_from_force()."""
    c, s, rate, squared = cos_yaw, sin_yaw, yaw_rate, yaw_rate * yaw_rate
    first = -rate * s, rate * c, 0.0
    second = -yaw_acceleration * s - squared * c, yaw_acceleration * c - squared * s, 0.0
    return (c, s, 0.0), first, second


def inverse_dynamics(
    flat_outputs: np.ndarray, vehicle: Vehicle, air: Air = STILL
) -> tuple[np.ndarray, np.ndarray]:
    """Inverse dynamics of a trajectory.

    Args:
        flat_outputs: samples as in trajopt/reference.py, shape (18, N).
        vehicle: the airrace.vehicle.Vehicle.
        air: that it flies through.

    Returns:
        (thrusts, w): thrust of every rotor (N), shape (n, N), by the
        pseudo-inverse of the allocation, not clipped to the limits; angular
        velocity in B (rad/s), shape (3, N).
    """
    r, force = as_reference(flat_outputs), thrust_vectors(flat_outputs, air=air)
    _, w, alpha = attitude_from_force(
        *force, heading_vectors(np.cos(r.yaw), np.sin(r.yaw), r.yaw_rate, r.yaw_acceleration)
    )
    amount = np.sqrt(dot(force[0], force[0]))
    thrust = vehicle.mass * (amount + axial_drag(r.velocity, force[0] / amount, 1.0, air))
    return np.linalg.pinv(vehicle.allocation) @ np.vstack([thrust, moments(vehicle, w, alpha)]), w


def moments(vehicle: Vehicle, w: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Returns the moments about the body's axes that turn it so (N m), (3, N).

    Args: w, alpha: angular velocity and acceleration in B, (3, N).
    """
    J = np.array(vehicle.inertia)[:, None]
    return J * alpha + cross(w, J * w)


def axial_drag(
    velocity: np.ndarray, b: np.ndarray, unit: float | np.ndarray, air: Air
) -> float | np.ndarray:
    """Returns how much thrust over mass it takes against drag along the thrust, (N,).

    Only the thrust has to make up for it: the attitude stays that of thrust_vectors().

    Args: velocity: (3, N). b: unit vectors along the thrust, likewise. unit, air: see there.
    """
    if air.is_still:
        return 0.0
    u = velocity - air.wind.reshape(3, *[1] * (velocity.ndim - 1)) * unit
    speed = np.sqrt(dot(u, u) + (_SLOW * unit) ** 2)
    return (air.axial_linear * unit + air.axial_quadratic * speed) * dot(u, b)


def thrust_vectors(
    flat_outputs: np.ndarray, unit: float | np.ndarray = 1.0, air: Air = STILL
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns thrust over mass, a + g e_z less drag, and its first two derivatives, (3, N) each.

    With drag that is the same in all directions, a multirotor stays flat: Faessler, Franchi and
    Scaramuzza, "Differential flatness of quadrotor dynamics subject to rotor drag" (RA-L 2018).

    Args:
        flat_outputs: samples as in trajopt/reference.py, shape (18, N), real or
            complex, with time in multiples of the unit.
        unit: of time (s), a number or (N,).
        air: that it flies through.
    """
    _, v, a, j, s, *_ = as_reference(flat_outputs)
    force = np.array((a[0], a[1], a[2] + GRAVITY * unit**2))
    if air.is_still:
        return force, j, s
    # With time in units T, drag is T^2 times what it is, so T times its linear part.
    u = v - air.wind.reshape(3, *[1] * (v.ndim - 1)) * unit
    speed = np.sqrt(dot(u, u) + (_SLOW * unit) ** 2)
    rate = dot(u, a) / speed
    rate_of_rate = (dot(a, a) + dot(u, j) - rate**2) / speed
    k = air.linear * unit + air.quadratic * speed
    dk, ddk = air.quadratic * rate, air.quadratic * rate_of_rate
    return force + k * u, j + dk * u + k * a, s + ddk * u + 2.0 * dk * a + k * j
