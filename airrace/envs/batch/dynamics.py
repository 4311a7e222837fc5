"""One step of a multirotor in the air, as Drake's plant makes it, in machine code.

It is that of vehicle/free_body.py, with rotors and drag. A test compares it with the discrete
MultibodyPlant of the race (see diagrams/simulation.py) over a second of flight.
"""

import math
from typing import NamedTuple

from airrace.common.jit import inlined
from airrace.math.triples import (
    Triple,
    added,
    difference,
    dot,
    rotate_back,
    rotation_rows,
    scaled,
    times,
)
from airrace.vehicle import free_body
from airrace.vehicle.free_body import Motion


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
    R_WB = rotation_rows(motion.quaternion)
    v_B = rotate_back(R_WB, difference(motion.velocity, wind))
    drag, drag_moment = _drag(v_B, rotate_back(R_WB, motion.angular_velocity), body)
    specific_force = scaled(1.0 / body.mass, (drag[0], drag[1], drag[2] + wrench.thrust))
    moment = added(wrench.moment, 1.0, drag_moment)
    return free_body.next_motion(motion, specific_force, moment, body.inertia, dt)


@inlined
def _drag(v_B, w_B, body):
    """Returns force (N) and moment (N m) in B of the air that the body moves through, see Drag."""
    speed = math.sqrt(dot(v_B, v_B))
    force = times(added(body.linear, speed, body.quadratic), v_B)
    moment = times(body.angular, w_B)
    return (-force[0], -force[1], -force[2]), (-moment[0], -moment[1], -moment[2])
