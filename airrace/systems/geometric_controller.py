"""Geometric tracking control on SE(3)."""

import functools
import math

import numpy as np
from pydrake.systems.framework import LeafSystem

from airrace.attitude import attitude_error, turned_back
from airrace.reduced_attitude import ROTOR_DELAY, ReducedAttitude
from airrace.rotor_loss import Remaining
from airrace.systems import state_estimate as se
from airrace.trajopt import flat_trajectory as ref
from airrace.trajopt.flatness import attitude_from_force, heading_vectors
from airrace.triples import columns, cross, dot
from airrace.vehicle import GRAVITY, Vehicle

_THRUST_SHARE = 0.9  # of what the rotors have: the rest is for the attitude
_LEAST_LIFT = 0.2 * GRAVITY  # m/s^2, so that errors never ask to point down
_YAW_REACH = 0.25  # rad, an error in yaw that takes all that the rotors have for it
_SHORT_LAG = 0.01  # s, that the rotors' lag is made to look like


class GeometricController(LeafSystem):
    """Lee, Leok, McClamroch: Geometric tracking control of a quadrotor UAV on
    SE(3), CDC 2010, with the paper's feed-forward.

    .. pydrake_system::

        name: GeometricController
        input_ports:
        - reference
        - filtered_estimate
        - disturbance
        - rotor_speeds
        - rotor_losses
        output_ports:
        - rotor_speed_command

    ``reference``: see trajopt/flat_trajectory.py; ``filtered_estimate``: see
    state_estimate.py; ``disturbance``: an acceleration to lean against (m/s^2,
    in the world), see StateFilter; ``rotor_speeds`` as reported, and
    ``rotor_speed_command``, held over the period: one speed a rotor (rad/s);
    ``rotor_losses``: see RotorMonitor.

    The desired angular velocity and acceleration come from the jerk and snap
    of the reference; the derivatives of the feedback terms, which would need
    the acceleration of the drone, are left out. The rotors are driven beyond
    the speeds that they should have, by as much as makes them get there sooner.

    With rotors lost, the wrench is allocated to the rest. If those cannot hold
    the yaw, the controller forgets the reference and comes down: see
    airrace/reduced_attitude.py.
    """

    def __init__(self, *, vehicle: Vehicle, rate: float, feed_forward: bool = True,
                 disturbance_rejection: bool = True):
        """Constructs the controller.

        Args:
            vehicle: mass, inertia, rotors and gains.
            rate: of the control loop (Hz).
            feed_forward: whether to use the reference's jerk, snap, and yaw
                rates; without, the desired angular velocity and acceleration
                are zero, as in the original system.
            disturbance_rejection: whether to lean against the disturbance.
        """
        LeafSystem.__init__(self)
        self._mass = vehicle.mass
        self._J = list(map(float, vehicle.inertia))
        self._k_x, self._k_v = vehicle.gains.position, vehicle.gains.velocity
        self._k_R, self._k_w = (gain.tolist() for gain in _attitude_gains(vehicle))
        self._c_f = vehicle.thrust_coefficients.tolist()
        self._max_speeds = vehicle.max_speeds.tolist()
        self._feed_forward = feed_forward
        self._rejection = float(disturbance_rejection)
        self._overdrive = _reached(rate, min(_SHORT_LAG, vehicle.rotor_lag)) / _reached(
            rate, vehicle.rotor_lag
        )
        n = len(vehicle.rotors)
        self._remaining = functools.cache(lambda working: Remaining(vehicle, working))
        self._max_thrust = _THRUST_SHARE * self._remaining((True,) * n).max_lift
        self._reduced = ReducedAttitude(vehicle)
        self._reference = self.DeclareVectorInputPort("reference", ref.SIZE)
        self._estimate = self.DeclareVectorInputPort("filtered_estimate", se.SIZE)
        self._disturbance = self.DeclareVectorInputPort("disturbance", 3)
        self._speeds = self.DeclareVectorInputPort("rotor_speeds", n)
        self._losses = self.DeclareVectorInputPort("rotor_losses", n)
        state = self.DeclareDiscreteState(n)
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / rate, 0.0, self._UpdateCommand)
        self.DeclareStateOutputPort("rotor_speed_command", state)

    def _UpdateCommand(self, context, discrete_state):
        # Plain numbers: arrays this small cost more than they spare.
        working = tuple(map(math.isinf, self._losses.Eval(context).tolist()))
        remaining = self._remaining(working)
        estimate = self._estimate.Eval(context).tolist()
        disturbance = [self._rejection * d for d in self._disturbance.Eval(context).tolist()]
        reference = self._reference.Eval(context).tolist() if remaining.can_fly else ()
        if not all(map(math.isfinite, (*estimate, *disturbance, *reference))):
            return  # the last command is the best there is
        if remaining.can_fly:
            reference[ref.ACCELERATION] = [
                a - d for a, d in zip(reference[ref.ACCELERATION], disturbance)]
            if not self._feed_forward:
                reference[ref.JERK] = reference[ref.SNAP] = [0.0, 0.0, 0.0]
                reference[ref.YAW_RATE] = reference[ref.YAW_ACCELERATION] = 0.0
            wrench = self.CalcWrench(reference, estimate)
        else:
            wrench = self._reduced.wrench(np.array(estimate), np.array(disturbance), remaining)
        if not all(map(math.isfinite, wrench.tolist())):
            return
        command = []
        for thrust, c_f, speed, limit, works in zip(
            remaining.allocator.allocate(wrench).tolist(), self._c_f,
            self._speeds.Eval(context).tolist(), self._max_speeds, working,
        ):
            faster = speed + self._overdrive * (math.sqrt(thrust / c_f) - speed)
            # NaN is not greater than zero.
            command.append(min(faster, limit) if works and faster > 0.0 else 0.0)
        discrete_state.set_value(np.array(command))

    def CalcWrench(self, reference, estimate) -> np.ndarray:
        """Returns total thrust (N) and moments in B (N m), shape (4,).

        Args:
            reference: of trajopt/flat_trajectory.py, 18 numbers; a list is fastest.
            estimate: of systems/state_estimate.py, 14 numbers.
        """
        r, e = reference, estimate
        k_x, k_v = self._k_x, self._k_v
        # Equation (23): the desired specific force, and its axis.
        force = [
            a - k_x * (p - p_d) - k_v * (v - v_d)
            for a, p, p_d, v, v_d in zip(
                r[ref.ACCELERATION], e[se.POSITION], r[ref.POSITION],
                e[se.VELOCITY], r[ref.VELOCITY],
            )
        ]
        force[2] += GRAVITY
        force = limited(force, self._max_thrust / self._mass)
        yaw, yaw_rate, yaw_acceleration = r[ref.YAW:]
        axes, w_d, alpha_d = attitude_from_force(
            force, r[ref.JERK], r[ref.SNAP],
            heading_vectors(math.cos(yaw), math.sin(yaw), yaw_rate, yaw_acceleration),
        )
        R = columns(*e[se.QUATERNION])
        E = [[dot(axis, column) for column in R] for axis in axes]  # R_d^T R
        ET = tuple(zip(*E))
        w = [dot(e[se.ANGULAR_VELOCITY], column) for column in R]
        w_d = [dot(w_d, column) for column in ET]
        e_w = [a - b for a, b in zip(w, w_d)]
        # Equations (15) and (16); gains are per unit of mass and inertia. The
        # third term keeps a spin that is yet to be stopped from turning the others.
        turning = (-e_w[2] * e_w[1], e_w[2] * e_w[0], 0.0)
        J = self._J
        moment = [
            J_i * (-k_R * e_R - k_w * de - turn - coupling + dot(alpha_d, column)) + gyroscopic
            for J_i, k_R, e_R, k_w, de, turn, coupling, column, gyroscopic in zip(
                J, self._k_R, attitude_error(E, w).tolist(), self._k_w, e_w, turning,
                cross(w, w_d), ET, cross(w, [J_i * w_i for J_i, w_i in zip(J, w)]),
            )
        ]
        moment = turned_back(moment, ROTOR_DELAY * w[2])
        return np.array([self._mass * max(dot(force, R[2]), 0.0), *moment])


def limited(force, greatest: float) -> tuple:
    """Returns the part of a desired specific force that rotors can give, (3,).

    Height goes first; to the side goes what is left.

    Args:
        force: (3,) in the world (m/s^2).
        greatest: amount (m/s^2).
    """
    x, y, z = force
    z = min(max(z, _LEAST_LIFT), greatest)
    side = math.hypot(x, y)
    share = min(1.0, math.sqrt(greatest**2 - z**2) / side) if side > 0.0 else 1.0
    return share * x, share * y, z


def _attitude_gains(vehicle: Vehicle):
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


def _reached(rate, lag) -> float:
    """Returns how much of a step a first-order lag makes in one period."""
    return 1.0 - math.exp(-1.0 / (rate * lag))
