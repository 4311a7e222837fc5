"""The control law: from a reference and a state to total thrust and moments."""

import math
from typing import NamedTuple

import numpy as np

from airrace.common.errors import UserError
from airrace.common.jit import compilable
from airrace.common.packing import Packing
from airrace.math.quaternion import rotation_matrix
from airrace.math.vec3 import cross, dot, rotate
from airrace.systems.control.attitude_error import lead_moment, lee_error, reduced_error
from airrace.systems.control.reduced_attitude import ROTOR_DELAY
from airrace.trajopt.flatness import attitude_from_force, heading_vectors
from airrace.trajopt.reference import NO_LIFT, Reference
from airrace.vehicle import GRAVITY, GRAVITY_W, Vehicle
from airrace.vehicle.rotor_loss import Remaining
from airrace.vehicle.state import State

_LEAST_LIFT = 0.2 * GRAVITY  # m/s^2, so that errors never ask to point down
_YAW_REACH = 0.25  # rad, an error in yaw that takes all that the rotors have for it


class ControlParameters(NamedTuple):
    """The vehicle and its gains, as lee_wrench() takes them."""

    mass: float  #: kg
    inertia: np.ndarray  #: principal moments in B (kg m^2), (3,)
    #: k_x, k_v: gains on errors in position (1/s^2) and velocity (1/s), per mass
    k_x: float
    k_v: float
    #: k_R, k_w: gains on errors in attitude (1/s^2) and angular velocity (1/s), per moment of
    #: inertia, (3,)
    k_R: np.ndarray
    k_w: np.ndarray
    max_force: float  #: the greatest specific force to ask for (m/s^2)
    reduced: bool  #: whether the tilt goes before the yaw, see lee_wrench()


_PACKING = Packing(ControlParameters, inertia=3, k_R=3, k_w=3)
as_parameters, parameters_vector = _PACKING.parts, _PACKING.vector


def make_parameters(vehicle: Vehicle, attitude_error: str, gains: str) -> ControlParameters:
    """Returns the parameters for a vehicle.

    Args:
        vehicle: mass, inertia, rotors and gains.
        attitude_error: "reduced" or "lee", see lee_wrench().
        gains: "vehicle", or "original" for the vehicle's original_gains as they are.

    Raises:
        UserError: if the vehicle has no original_gains.
    """
    inertia = np.array(vehicle.inertia)
    if gains == "original":
        k = vehicle.original_gains
        if k is None:
            raise UserError(
                f"controller.gains 'original' needs original_gains in the vehicle.yaml of "
                f"{vehicle.name}; add them, or take the gains 'vehicle'."
            )
        k_x, k_v = k.position / vehicle.mass, k.velocity / vehicle.mass
        k_R, k_w = k.attitude / inertia, k.angular_velocity / inertia
    else:
        k_x, k_v = vehicle.gains.position, vehicle.gains.velocity
        k_R, k_w = _attitude_gains(vehicle)
    return ControlParameters(
        mass=vehicle.mass,
        inertia=inertia,
        k_x=k_x,
        k_v=k_v,
        k_R=k_R,
        k_w=k_w,
        max_force=Remaining(vehicle, np.ones(len(vehicle.rotors), bool)).max_lift / vehicle.mass,
        reduced=attitude_error == "reduced",
    )


def _attitude_gains(vehicle: Vehicle) -> tuple[np.ndarray, np.ndarray]:
    """Returns the gains on the errors in attitude and angular velocity, (3,) each.

    Rotors have far less moment about z than about x and y: with the same gains
    there, small errors would take all of it, and an error that goes round and
    round would not be damped.
    """
    inverse = np.linalg.pinv(vehicle.allocation)
    hover = inverse[:, 0] * vehicle.mass * GRAVITY
    moment = (np.minimum(hover, vehicle.max_thrusts - hover) / np.abs(inverse[:, 3])).min()
    k_R = np.full(3, vehicle.gains.attitude)
    k_R[2] = min(k_R[2], max(moment, 0.0) / vehicle.inertia[2] / _YAW_REACH)
    return k_R, vehicle.gains.angular_velocity * np.sqrt(k_R / vehicle.gains.attitude)


@compilable
def lee_wrench(reference: Reference, state: State, parameters: ControlParameters) -> np.ndarray:
    """Returns total thrust (N) and moments in B (N m), [f, Mx, My, Mz], (4,).

    They are equations (15) and (16) of Lee, Leok, McClamroch (CDC 2010), z upwards and with
    gains per mass and inertia. What the rotors cannot give is not asked for: the force is
    limited(), and the thrust not negative. A reference without any lift, see idle(), asks for
    nothing at all.

    With ``reduced``, there are three changes: e_R is reduced_error() and not the paper's,
    equation (10); the damping of roll and pitch does not turn with a spin that is yet to be
    stopped; and the moment leads the rotors' delay, see lead_moment().

    Args: reference: D, the desired motion. state: of the body B. parameters: of the vehicle.
    """
    if reference.acceleration[2] < NO_LIFT:
        return np.zeros(4)
    mass, J, k_x, k_v, k_R, k_w, max_force, reduced = parameters
    force = limited(
        k_x * (reference.position - state.position)
        + k_v * (reference.velocity - state.velocity)
        + reference.acceleration
        - GRAVITY_W,
        max_force,
    )
    # R_d by equation (12), and its derivatives.
    axes, w_D, alpha_D = attitude_from_force(
        force,
        reference.jerk,
        reference.snap,
        heading_vectors(
            math.cos(reference.yaw),
            math.sin(reference.yaw),
            reference.yaw_rate,
            reference.yaw_acceleration,
        ),
    )
    R_WB, (x_D, y_D, z_D) = rotation_matrix(state.quaternion), axes
    R_BW = R_WB.T
    R_BD = np.column_stack((rotate(R_BW, x_D), rotate(R_BW, y_D), rotate(R_BW, z_D)))
    w = rotate(R_BW, state.angular_velocity)
    w_d, alpha_d = rotate(R_BD, w_D), rotate(R_BD, alpha_D)
    e_w = w - w_d  # equation (11)
    if reduced:
        spin = np.array((-e_w[2] * e_w[1], e_w[2] * e_w[0], 0.0))
        alpha = -k_R * reduced_error(R_BD.T, w) - k_w * e_w - spin
    else:
        alpha = -k_R * lee_error(R_BD.T) - k_w * e_w
    moment = J * (alpha - cross(w, w_d) + alpha_d) + cross(w, J * w)
    if reduced:
        moment = lead_moment(moment, ROTOR_DELAY * w[2])
    Mx, My, Mz = moment
    thrust = mass * max(dot(force, R_WB[:, 2]), 0.0)
    return np.array((thrust, Mx, My, Mz))


@compilable
def limited(force: np.ndarray, greatest: float) -> np.ndarray:
    """Returns the part of a desired specific force that rotors can give, (3,).

    Height goes first; to the side goes what is left.

    Args: force: (3,) in the world (m/s^2). greatest: amount (m/s^2).
    """
    x, y, z = force
    z = min(max(z, _LEAST_LIFT), greatest)
    side = math.hypot(x, y)
    share = min(1.0, math.sqrt(greatest**2 - z**2) / side) if side > 0.0 else 1.0
    return np.array((share * x, share * y, z))
