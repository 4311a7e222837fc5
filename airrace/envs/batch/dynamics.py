"""One step of a multirotor in the air, as Drake's plant makes it, in machine code.

The discrete MultibodyPlant of the race (see diagrams/simulation.py) advances a free body by
semi-implicit Euler: forces and the gyroscopic moment are those of the start of the step, the
velocity of its end then moves the pose, and the quaternion is not normalised (Castro et al.,
"An unconstrained convex formulation of compliant contact", 2022, where there is no contact).
A test compares both over a second of flight.
"""

import math
from typing import NamedTuple

from airrace.common.jit import inlined
from airrace.math.triples import (
    Quaternion,
    Triple,
    added,
    cross,
    difference,
    dot,
    quaternion_added,
    rotate,
    rotate_back,
    rotation_rows,
    times,
)
from airrace.vehicle import GRAVITY


class Motion(NamedTuple):
    """Pose and velocity of the body B in the world W, as in vehicle/state.py, but as tuples.

    Attributes:
        quaternion: of R_WB, [w, x, y, z].
        position: p_WB (m).
        angular_velocity: w_WB, in the axes of W (rad/s).
        velocity: v_WB, in the axes of W (m/s).
    """

    quaternion: Quaternion
    position: Triple
    angular_velocity: Triple
    velocity: Triple


class Wrench(NamedTuple):
    """Of the rotors: total thrust along body z (N), and moments in B (N m)."""

    thrust: float
    moment: Triple


class Body(NamedTuple):
    """What the air and the rotors move.

    Attributes:
        mass: (kg). inertia: principal moments in B (kg m^2).
        linear, quadratic, angular: coefficients of drag, see systems/plant/drag.py.
    """

    mass: float
    inertia: Triple
    linear: Triple
    quadratic: Triple
    angular: Triple


@inlined
def next_motion(motion: Motion, wrench: Wrench, wind: Triple, body: Body, dt: float) -> Motion:
    """Returns the motion after a step of the plant.

    Args:
        motion: before the step.
        wrench: of the rotors.
        wind: velocity of the air in the world (m/s).
        body: that moves.
        dt: of the step (s).
    """
    q, p, w, v = motion
    J, R_WB = body.inertia, rotation_rows(q)
    w_B = rotate_back(R_WB, w)
    force_B, drag_moment = _drag(rotate_back(R_WB, difference(v, wind)), w_B, body)
    moment = added(wrench.moment, 1.0, drag_moment)
    # Euler's equation of rotation, and Newton's law.
    M = difference(moment, cross(w_B, times(J, w_B)))
    alpha_B = (M[0] / J[0], M[1] / J[1], M[2] / J[2])
    a = rotate(R_WB, (force_B[0], force_B[1], force_B[2] + wrench.thrust))
    w = added(w, dt, rotate(R_WB, alpha_B))
    v = added(v, dt / body.mass, a)
    v = (v[0], v[1], v[2] - dt * GRAVITY)
    return Motion(quaternion_added(q, dt, w), added(p, dt, v), w, v)


@inlined
def _drag(v_B, w_B, body):
    """Returns force (N) and moment (N m) in B of the air that the body moves through, see Drag."""
    speed = math.sqrt(dot(v_B, v_B))
    force = times(added(body.linear, speed, body.quadratic), v_B)
    moment = times(body.angular, w_B)
    return (-force[0], -force[1], -force[2]), (-moment[0], -moment[1], -moment[2])
