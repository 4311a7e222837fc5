"""Geometric tracking control on SE(3)."""

import math

import numpy as np
from pydrake.systems.framework import LeafSystem

from airrace.allocation import Allocator
from airrace.systems import state_estimate as se
from airrace.trajopt import flat_trajectory as ref
from airrace.trajopt.flatness import attitude_from_force, heading_vectors
from airrace.vehicle import GRAVITY, Vehicle


class GeometricController(LeafSystem):
    """Lee, Leok, McClamroch: Geometric tracking control of a quadrotor UAV on
    SE(3), CDC 2010, with the paper's feed-forward.

    .. pydrake_system::

        name: GeometricController
        input_ports:
        - reference
        - filtered_estimate
        output_ports:
        - rotor_speed_command

    ``reference``: see trajopt/flat_trajectory.py; ``filtered_estimate``:
    see state_estimate.py; ``rotor_speed_command``: one speed a rotor (rad/s),
    held over the period.

    The desired angular velocity and acceleration come from the jerk and snap
    of the reference; the derivatives of the feedback terms, which would need
    the acceleration of the drone, are left out.
    """

    def __init__(self, *, vehicle: Vehicle, rate: float):
        """Constructs the controller.

        Args:
            vehicle: mass, inertia, rotors and gains.
            rate: of the control loop (Hz).
        """
        LeafSystem.__init__(self)
        gains = vehicle.gains
        self._mass = vehicle.mass
        self._J = np.array(vehicle.inertia)
        self._k_x, self._k_v = gains.position, gains.velocity
        self._k_R, self._k_w = gains.attitude, gains.angular_velocity
        self._c_f = vehicle.thrust_coefficients
        self._allocator = Allocator(vehicle.allocation, vehicle.max_thrusts)
        self._reference = self.DeclareVectorInputPort("reference", ref.SIZE)
        self._estimate = self.DeclareVectorInputPort("filtered_estimate", se.SIZE)
        state = self.DeclareDiscreteState(len(vehicle.rotors))
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / rate, 0.0, self._UpdateCommand)
        self.DeclareStateOutputPort("rotor_speed_command", state)

    def _UpdateCommand(self, context, discrete_state):
        wrench = self.CalcWrench(self._reference.Eval(context), self._estimate.Eval(context))
        discrete_state.set_value(np.sqrt(self._allocator.allocate(wrench) / self._c_f))

    def CalcWrench(self, reference, estimate) -> np.ndarray:
        """Returns total thrust (N) and moments in B (N m), shape (4,).

        Args:
            reference: of trajopt/flat_trajectory.py, (18,).
            estimate: of systems/state_estimate.py, (14,).
        """
        R = _rotation_matrix(*estimate[se.QUATERNION].tolist())
        position_error = estimate[se.POSITION] - reference[ref.POSITION]
        velocity_error = estimate[se.VELOCITY] - reference[ref.VELOCITY]
        # Equation (23): the desired specific force, and its axis.
        force = reference[ref.ACCELERATION] - self._k_x * position_error
        force -= self._k_v * velocity_error
        force[2] += GRAVITY
        yaw, yaw_rate, yaw_acceleration = reference[ref.YAW:].tolist()
        axes, w_d, alpha_d = attitude_from_force(
            _upward(force.tolist()),
            reference[ref.JERK].tolist(),
            reference[ref.SNAP].tolist(),
            heading_vectors(math.cos(yaw), math.sin(yaw), yaw_rate, yaw_acceleration),
        )
        # Equations (19) and (20), in the body frame.
        R_d = np.array(axes).T
        E = R_d.T @ R
        S = E - E.T
        attitude_error = 0.5 * np.array([S[2, 1], S[0, 2], S[1, 0]])
        w = R.T @ estimate[se.ANGULAR_VELOCITY]
        w_d = E.T @ w_d
        # Equations (15) and (16); gains are per unit of mass and inertia.
        Jw = self._J * w
        moment = self._J * (
            -self._k_R * attitude_error
            - self._k_w * (w - w_d)
            - _cross(w, w_d)
            + E.T @ alpha_d
        ) + _cross(w, Jw)
        return np.array([self._mass * force.dot(R[:, 2]), *moment])


def _upward(force):
    """Keeps a desired force from vanishing or pointing down.

    Large errors could ask for it; the drone would then flip over.
    """
    return (force[0], force[1], max(force[2], 0.2 * GRAVITY))


def _cross(a, b):
    # numpy's own costs ten times as much on a single pair.
    a0, a1, a2 = a.tolist()
    b0, b1, b2 = b.tolist()
    return np.array([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0])


def _rotation_matrix(w, x, y, z):
    """Rotation matrix (3, 3) of a quaternion of any length."""
    s = 2.0 / (w * w + x * x + y * y + z * z)
    return np.array([
        [1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
        [s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)],
        [s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)],
    ])
