"""Coming down on the rotors that are left: the thrust axis up, the yaw let go."""

import math

import numpy as np

from airrace.math.quaternion import rotation_matrix
from airrace.math.vec3 import cross
from airrace.systems.control.attitude_error import lead_moment, tilt_error
from airrace.vehicle import GRAVITY, Vehicle
from airrace.vehicle.rotor_loss import Remaining
from airrace.vehicle.state import as_state

ROTOR_DELAY = 0.022  # s, from a moment that is wanted to the rotors' answer
_DESCENT = 0.5  # m/s
_BRAKE = 2.0  # 1/s, from an error in velocity to an acceleration
_MAX_SIDE = 0.5 * GRAVITY  # m/s^2, to the side
_MOST_LIFT = 2.0  # for the tilt, as a factor
# How far the trim goes from the thrusts that need no spin to equal ones: little at a
# slow spin, which cannot balance more; beyond equal at a fast one, to stop it growing.
_SHARED = (0.3, 1.5)
_SPINS = (20.0, 40.0)  # rad/s
_MAX_LEAN = 0.3  # of the spin axis, as a tangent


class ReducedAttitude:
    """Reduced-attitude control with a sink rate, for a drone that cannot hold its yaw.

    A quadrotor without one rotor is left with no rotor to push one side down.
    But it can spin: if its axis of rotation leans a little towards the rotor
    opposite the lost one, gyroscopic moments make up for that rotor's thrust,
    which can then go up as well as down. Mueller and D'Andrea, "Stability and
    control of a quadrocopter despite the complete loss of one, two, or three
    propellers" (ICRA 2014), section III, find that motion; here its axis, which
    is fixed in the body for a given spin, is what the control holds upright.
    The spin itself is left to the rotors and to the air.
    """

    def __init__(self, vehicle: Vehicle):
        """Args: vehicle: when whole."""
        self._mass = vehicle.mass
        self._J = np.array(vehicle.inertia)
        self._allocation = vehicle.allocation
        self._k_R, self._k_w = vehicle.gains.attitude, vehicle.gains.angular_velocity

    def wrench(
        self, estimate: np.ndarray, disturbance: np.ndarray, remaining: Remaining
    ) -> np.ndarray:
        """Returns total thrust (N) and moments in B (N m), shape (4,).

        Args:
            estimate: vector of a State, (14,).
            disturbance: acceleration to lean against (m/s^2), in the world, (3,).
            remaining: the rotors; their thrusts follow without regard to yaw.
        """
        state = as_state(estimate)
        R = rotation_matrix(state.quaternion)
        w = state.angular_velocity @ R
        axis = self.spin_axis(w[2], remaining)
        force = self._desired_force(state.velocity, disturbance)
        amount = math.sqrt(force.dot(force))
        n_d = force @ R / amount
        # As if the axes did not spin: their turning moves what is at rest.
        spin = w.dot(axis)
        w_side = w - spin * axis
        acceleration = (
            -self._k_R * tilt_error(n_d, axis, w) - self._k_w * w_side - spin * cross(axis, w_side)
        )
        trim = cross(spin * axis, spin * self._J * axis)
        moment = self._J * acceleration + cross(w, self._J * w) - trim
        moment = lead_moment(moment, ROTOR_DELAY * w[2]) + trim
        # Keeps up the vertical part of the thrust when tilted.
        cosine = n_d.dot(axis)
        lift = min(1.0 / cosine, _MOST_LIFT) if cosine > 0.0 else 0.0
        return np.array([self._mass * amount * lift / axis[2], *moment])

    def spin_axis(self, spin: float, remaining: Remaining) -> np.ndarray:
        """Returns the body axis to hold upright, a unit vector in B, (3,).

        With an angular velocity w along it, w x J w is the moment of the trim.

        Args: spin: about z (rad/s). remaining: the rotors.
        """
        if remaining.can_hold_level or not remaining.max_thrusts.any():
            return np.array([0.0, 0.0, 1.0])
        weight = self._mass * GRAVITY
        level = remaining.allocator.allocate(np.array([weight, 0.0, 0.0, 0.0]))
        works = remaining.max_thrusts > 0
        equal = works * weight / works.sum()
        shared = np.interp(abs(spin), _SPINS, _SHARED)
        _, Mx, My, _ = self._allocation @ (level + shared * (equal - level))
        Jx, Jy, Jz = self._J
        differences = np.array([Jx - Jz, Jz - Jy])
        differences[differences == 0.0] = 1e-9  # no lean will do; the greatest is as good as any
        # w x J w = [(Jz - Jy) w_y w_z, (Jx - Jz) w_x w_z, ...], solved for w_x and w_y
        # over w_z; a lean that the spin is too slow for is cut short.
        lean = np.array([My, Mx]) / differences / max(spin * spin, 1e-6)
        lean *= min(1.0, _MAX_LEAN / max(math.hypot(*lean), 1e-9))
        return np.array([*lean, 1.0]) / math.hypot(*lean, 1.0)

    def _desired_force(self, velocity: np.ndarray, disturbance: np.ndarray) -> np.ndarray:
        """Returns the specific force that brakes to the sink rate (m/s^2), (3,)."""
        force = -disturbance - _BRAKE * (velocity + [0.0, 0.0, _DESCENT])
        force[:2] *= min(1.0, _MAX_SIDE / max(math.hypot(force[0], force[1]), 1e-9))
        force[2] = max(force[2], -0.5 * GRAVITY) + GRAVITY
        return force
