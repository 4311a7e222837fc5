"""How a rigid body moves in the air: its equations of motion, and two ways to integrate them.

Who predicts a drone takes them from here: the batch of environments, the compensation of a link's
delay, the state filter, and the strapdown integrator. Results are tuples, see math/triples.py.
"""

from typing import NamedTuple

import numpy as np

from airrace.common.jit import compilable, inlined
from airrace.math.triples import (
    Quaternion,
    Rows,
    Triple,
    added,
    cross,
    difference,
    quaternion_added,
    rotate,
    rotate_back,
    rotation_rows,
    times,
)
from airrace.vehicle.state import State
from airrace.vehicle.vehicle import GRAVITY

type Vector = Triple | np.ndarray

_NOTHING = (0.0, 0.0, 0.0)


class Motion(NamedTuple):
    """Pose and velocity of the body B in the world W, as in vehicle/state.py, but as tuples."""

    quaternion: Quaternion  #: of R_WB, [w, x, y, z]
    position: Triple  #: p_WB (m)
    angular_velocity: Triple  #: w_WB, in the axes of W (rad/s)
    velocity: Triple  #: v_WB, in the axes of W (m/s)


@compilable
def motion_of(state: State) -> Motion:
    """Returns the motion of a state."""
    q, p, w, v = state.quaternion, state.position, state.angular_velocity, state.velocity
    return Motion(
        (q[0], q[1], q[2], q[3]), (p[0], p[1], p[2]), (w[0], w[1], w[2]), (v[0], v[1], v[2])
    )


@inlined
def angular_acceleration(moment: Vector, w_B: Vector, inertia: Vector) -> Triple:
    """Returns dw/dt in B (rad/s^2), by Euler's equations J dw/dt = M - w x J w.

    Args: moment: M, in B (N m). w_B: w_WB, in B (rad/s). inertia: moments J in B (kg m^2).
    """
    J, M = inertia, difference(moment, cross(w_B, times(inertia, w_B)))
    return (M[0] / J[0], M[1] / J[1], M[2] / J[2])


@inlined
def linear_acceleration(
    R_WB: Rows, specific_force: Vector, disturbance: Vector = _NOTHING
) -> Triple:
    """Returns dv/dt in W (m/s^2), by Newton's law: R f + d + g.

    Args:
        specific_force: f, force by mass without gravity, in B (m/s^2).
        disturbance: d, acceleration by whatever else there is, in W (m/s^2).
    """
    a = added(rotate(R_WB, specific_force), 1.0, disturbance)
    return (a[0], a[1], a[2] - GRAVITY)


@inlined
def next_motion(
    motion: Motion, specific_force: Vector, moment: Vector, inertia: Vector, dt: float
) -> Motion:
    """Returns the motion after a step of semi-implicit Euler, as Drake's discrete plant makes it.

    Accelerations are those of the start of the step, the velocity of its end then moves the pose,
    and the quaternion is not normalised (Castro et al., "An unconstrained convex formulation of
    compliant contact", 2022, where there is no contact).

    Args: see linear_acceleration() and angular_acceleration(); dt: of the step (s).
    """
    q, p, w, v = motion
    R_WB = rotation_rows(q)
    w_dot = rotate(R_WB, angular_acceleration(moment, rotate_back(R_WB, w), inertia))
    w, v = added(w, dt, w_dot), added(v, dt, linear_acceleration(R_WB, specific_force))
    return Motion(quaternion_added(q, dt, w), added(p, dt, v), w, v)


@inlined
def at_constant_acceleration(
    position: Vector, velocity: Vector, acceleration: Vector, dt: float
) -> tuple[Triple, Triple]:
    """Returns position (m) and velocity (m/s) after a time dt (s) at an acceleration (m/s^2)."""
    p, v, a = position, velocity, acceleration
    return added(p, dt, added(v, 0.5 * dt, a)), added(v, dt, a)
