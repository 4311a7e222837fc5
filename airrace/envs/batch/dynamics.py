"""One step of a multirotor in the air, as Drake's plant makes it, in machine code.

The discrete MultibodyPlant of the race (see diagrams/simulation.py) advances a free body by
semi-implicit Euler: forces and the gyroscopic moment are those of the start of the step, the
velocity of its end then moves the pose, and the quaternion is not normalised (Castro et al.,
"An unconstrained convex formulation of compliant contact", 2022, where there is no contact).
A test compares both over a second of flight.
"""

import math
from typing import NamedTuple

import numpy as np

from airrace.common.jit import compilable
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
from airrace.vehicle import GRAVITY, Vehicle


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


class Bodies(NamedTuple):
    """What N drones are made of; a row is one drone, which has n rotors.

    Attributes:
        mass: (kg), (N,).
        inertia: principal moments in B (kg m^2), (N, 3).
        thrust_coefficients: c_f of each rotor (N s^2), (N, n).
        max_speeds: of each rotor (rad/s), (n,).
        step_share: how much of a step in the command a rotor makes in one period, see
            vehicle/rotors.py.
        levers: what moments [Mx, My, Mz] a thrust of 1 N of each rotor gives (m), (n, 3).
        drag: linear, quadratic and angular coefficients, see systems/plant/drag.py, (3, 3).
    """

    mass: np.ndarray
    inertia: np.ndarray
    thrust_coefficients: np.ndarray
    max_speeds: np.ndarray
    step_share: float
    levers: np.ndarray
    drag: np.ndarray


def make_bodies(vehicle: Vehicle, count: int, rotor_period: float, drag_share: float) -> Bodies:
    """Returns equal drones, as the vehicle's file describes them.

    Args:
        vehicle: the drone.
        count: of drones.
        rotor_period: between two updates of the rotors' speeds (s).
        drag_share: of the vehicle's drag; 0 is none, 1 is all.
    """
    drag = [vehicle.drag.linear, vehicle.drag.quadratic, vehicle.drag.angular]
    return Bodies(
        mass=np.full(count, vehicle.mass),
        inertia=np.tile(np.array(vehicle.inertia), (count, 1)),
        thrust_coefficients=np.tile(vehicle.thrust_coefficients, (count, 1)),
        max_speeds=vehicle.max_speeds,
        step_share=float(1.0 - np.exp(-rotor_period / vehicle.rotor_lag)),
        levers=np.ascontiguousarray(vehicle.allocation[1:].T),
        drag=drag_share * np.array(drag),
    )


@compilable
def rotor_wrench(i: int, thrusts: np.ndarray, bodies: Bodies) -> tuple[float, Triple]:
    """Returns total thrust (N) along body z, and moments in B (N m), of drone i.

    Args:
        i: number of the drone.
        thrusts: of its rotors (N), (N, n).
        bodies: all drones.
    """
    total, x, y, z = 0.0, 0.0, 0.0, 0.0
    for k in range(thrusts.shape[1]):
        thrust = thrusts[i, k]
        total += thrust
        x += bodies.levers[k, 0] * thrust
        y += bodies.levers[k, 1] * thrust
        z += bodies.levers[k, 2] * thrust
    return total, (x, y, z)


@compilable
def next_motion(
    i: int, motion: Motion, wrench: tuple[float, Triple], wind: Triple, bodies: Bodies, dt: float
) -> Motion:
    """Returns the motion of drone i after a step of the plant.

    Args:
        i: number of the drone.
        motion: before the step.
        wrench: of its rotors, see rotor_wrench().
        wind: velocity of the air in the world (m/s).
        bodies: all drones.
        dt: of the step (s).
    """
    q, p, w, v = motion
    total, moment = wrench
    J = (bodies.inertia[i, 0], bodies.inertia[i, 1], bodies.inertia[i, 2])
    R_WB = rotation_rows(q)
    w_B = rotate_back(R_WB, w)
    force_B, drag_moment = _drag(rotate_back(R_WB, difference(v, wind)), w_B, bodies.drag)
    moment = added(moment, 1.0, drag_moment)
    # Euler's equation of rotation, and Newton's law.
    M = difference(moment, cross(w_B, times(J, w_B)))
    alpha_B = (M[0] / J[0], M[1] / J[1], M[2] / J[2])
    a = rotate(R_WB, (force_B[0], force_B[1], force_B[2] + total))
    w = added(w, dt, rotate(R_WB, alpha_B))
    v = added(v, dt / bodies.mass[i], a)
    v = (v[0], v[1], v[2] - dt * GRAVITY)
    return Motion(quaternion_added(q, dt, w), added(p, dt, v), w, v)


@compilable
def _drag(v_B, w_B, coefficients):
    """Returns force (N) and moment (N m) in B of the air that the body moves through, see Drag."""
    c, speed = coefficients, math.sqrt(dot(v_B, v_B))
    return (
        (
            -(c[0, 0] + c[1, 0] * speed) * v_B[0],
            -(c[0, 1] + c[1, 1] * speed) * v_B[1],
            -(c[0, 2] + c[1, 2] * speed) * v_B[2],
        ),
        (-c[2, 0] * w_B[0], -c[2, 1] * w_B[1], -c[2, 2] * w_B[2]),
    )


@compilable
def follow_commands(
    i: int, speeds: np.ndarray, thrusts: np.ndarray, commands: np.ndarray, bodies: Bodies
) -> None:
    """Advances the rotors of drone i by a period, see systems/plant/rotor_bank.py.

    Args:
        i: number of the drone.
        speeds: of all drones' rotors (rad/s), (N, n); row i is changed.
        thrusts: (N), (N, n); row i is changed.
        commands: speeds to reach (rad/s), (N, q, n), of which the first count; negative ones
            and NaN count as zero.
        bodies: all drones.
    """
    for k in range(speeds.shape[1]):
        command = commands[i, 0, k]
        target = min(command, bodies.max_speeds[k]) if command > 0.0 else 0.0
        speeds[i, k] += bodies.step_share * (target - speeds[i, k])
        thrusts[i, k] = bodies.thrust_coefficients[i, k] * speeds[i, k] * speeds[i, k]
