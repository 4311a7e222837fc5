"""Geometric tracking control on SE(3)."""

import functools
import math

import numpy as np
from pydrake.systems.framework import LeafSystem

from airrace.common.jit import all_finite, compilable, compiled
from airrace.math.vec3 import columns, cross, dot, in_axes, sum2, transposed, triple
from airrace.systems.control.attitude_error import attitude_error, turned_back
from airrace.systems.control.reduced_attitude import ROTOR_DELAY, ReducedAttitude
from airrace.systems.ports import read_vector
from airrace.trajopt.flatness import attitude_from_force, heading_vectors
from airrace.trajopt.reference import REFERENCE_SIZE, as_reference
from airrace.vehicle import GRAVITY, Vehicle
from airrace.vehicle.allocation import by_inverse
from airrace.vehicle.rotor_loss import Remaining
from airrace.vehicle.state import STATE_SIZE, as_state

_THRUST_SHARE = 0.95  # of what the rotors have: the rest is for the attitude
_LEAST_LIFT = 0.2 * GRAVITY  # m/s^2, so that errors never ask to point down
_YAW_REACH = 0.25  # rad, an error in yaw that takes all that the rotors have for it
_SHORT_LAG = 0.01  # s, that the rotors' lag is made to look like
# What machine code needs is handed over in few arrays, since each costs time. Of the vehicle
# and its gains: mass, inertia, gains on errors in position, velocity, attitude and angular
# velocity (the last two per unit of inertia), the greatest thrust, what is made of the
# disturbance and of the reference's higher derivatives, and the overdrive of the rotors.
_MASS, _J, _K_X, _K_V, _K_R, _K_W = 0, slice(1, 4), 4, 5, slice(6, 9), slice(9, 12)
_MAX_THRUST, _REJECTION, _FEED_FORWARD, _OVERDRIVE = 12, 13, 14, 15
# Of every rotor: its row of the allocator's inverse, greatest thrust, c_f and greatest speed.
_INVERSE, _LIMIT, _C_F, _MAX_SPEED = slice(0, 4), 4, 5, 6


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

    ``reference``: see trajopt/reference.py; ``filtered_estimate``: see
    vehicle/state.py; ``disturbance``: an acceleration to lean against (m/s^2,
    in the world), see StateFilter; ``rotor_speeds`` as reported, and
    ``rotor_speed_command``, held over the period: one speed a rotor (rad/s);
    ``rotor_losses``: see RotorMonitor.

    The desired angular velocity and acceleration come from the jerk and snap
    of the reference; the derivatives of the feedback terms, which would need
    the acceleration of the drone, are left out. The rotors are driven beyond
    the speeds that they should have, by as much as makes them get there sooner.

    With rotors lost, the wrench is allocated to the rest. If those cannot hold
    the yaw, the controller forgets the reference and comes down: see
    airrace/systems/control/reduced_attitude.py.
    """

    def __init__(
        self,
        *,
        vehicle: Vehicle,
        rate: float,
        feed_forward: bool = True,
        disturbance_rejection: bool = True,
    ):
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
        n = len(vehicle.rotors)

        @functools.cache
        def remaining(losses: bytes):
            rest = Remaining(vehicle, np.isinf(np.frombuffer(losses)))
            return rest, np.column_stack(
                [
                    rest.allocator.inverse,
                    rest.max_thrusts,
                    vehicle.thrust_coefficients,
                    vehicle.max_speeds,
                ]
            )

        self._remaining = remaining
        whole = remaining(np.full(n, np.inf).tobytes())[0]
        overdrive = _reached(rate, min(_SHORT_LAG, vehicle.rotor_lag)) / _reached(
            rate, vehicle.rotor_lag
        )
        self._gains = np.array(
            [
                vehicle.mass,
                *vehicle.inertia,
                vehicle.gains.position,
                vehicle.gains.velocity,
                *np.ravel(_attitude_gains(vehicle)),
                _THRUST_SHARE * whole.max_lift,
                disturbance_rejection,
                feed_forward,
                overdrive,
            ]
        )
        self._reduced = ReducedAttitude(vehicle)
        self._reference = self.DeclareVectorInputPort("reference", REFERENCE_SIZE)
        self._estimate = self.DeclareVectorInputPort("filtered_estimate", STATE_SIZE)
        self._disturbance = self.DeclareVectorInputPort("disturbance", 3)
        self._speeds = self.DeclareVectorInputPort("rotor_speeds", n)
        self._losses = self.DeclareVectorInputPort("rotor_losses", n)
        state = self.DeclareDiscreteState(n)
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / rate, 0.0, self._update_command)
        self.DeclareStateOutputPort("rotor_speed_command", state)

    def _update_command(self, context, discrete_state):
        remaining, rotors = self._remaining(read_vector(self._losses, context).tobytes())
        estimate, disturbance = (
            read_vector(self._estimate, context),
            read_vector(self._disturbance, context),
        )
        if not remaining.can_fly:
            if not (all_finite(estimate) and all_finite(disturbance)):
                return  # the last command is the best there is
            push = self._gains[_REJECTION] * disturbance
            wrench = self._reduced.wrench(estimate, push, remaining)
        else:
            reference = self._reference.Eval(context)
            if not _prepared(reference, estimate, disturbance, self._gains):
                return
            wrench = self.calc_wrench(reference, estimate)
        commands, speeds = discrete_state.get_mutable_value(), read_vector(self._speeds, context)
        complete = remaining.allocator.is_complete
        if complete and _command_wrench(commands, wrench, speeds, rotors, self._gains):
            return  # as a rule
        if all_finite(wrench):
            thrusts = remaining.allocator.allocate(wrench)
            _command(commands, thrusts, speeds, rotors, self._gains)

    def calc_wrench(self, reference, estimate) -> np.ndarray:
        """Returns total thrust (N) and moments in B (N m), shape (4,).

        Args:
            reference: of trajopt/reference.py, (18,).
            estimate: of vehicle/state.py, (14,).
        """
        return _wrench(reference, estimate, self._gains)


@compiled
def _prepared(reference, estimate, disturbance, gains) -> bool:
    """Changes the reference into what is to be done; returns whether all of it is finite."""
    r = as_reference(reference)
    for i in range(3):
        r.acceleration[i] -= gains[_REJECTION] * disturbance[i]
    if gains[_FEED_FORWARD] == 0.0:
        r.jerk[:], r.snap[:], reference[-2:] = 0.0, 0.0, 0.0
    return all_finite(estimate) and all_finite(disturbance) and all_finite(reference)


@compiled
def _wrench(r, e, gains):
    """See GeometricController.calc_wrench()."""
    mass, k_x, k_v = gains[_MASS], gains[_K_X], gains[_K_V]
    J, k_R, k_w = gains[_J], gains[_K_R], gains[_K_W]
    r, e = as_reference(r), as_state(e)
    # Equation (23): the desired specific force, and its axis.
    x, y, z = r.acceleration - k_x * (e.position - r.position) - k_v * (e.velocity - r.velocity)
    force = limited((x, y, z + GRAVITY), gains[_MAX_THRUST] / mass)
    axes, w_W, alpha_d = attitude_from_force(
        force,
        triple(r.jerk, 0),
        triple(r.snap, 0),
        heading_vectors(math.cos(r.yaw), math.sin(r.yaw), r.yaw_rate, r.yaw_acceleration),
    )
    q = e.quaternion
    R = columns(q[0], q[1], q[2], q[3])
    # R_d^T R; its columns take from the desired body to the one there is.
    E = (in_axes(axes[0], R), in_axes(axes[1], R), in_axes(axes[2], R))
    ET = transposed(E)
    w = in_axes(triple(e.angular_velocity, 0), R)
    w_d, alpha_d = in_axes(w_W, ET), in_axes(alpha_d, ET)
    e_R, e_w = attitude_error(E, w), sum2(1.0, w, -1.0, w_d)
    # Keeps a spin that is yet to be stopped from turning the others.
    turning = (-e_w[2] * e_w[1], e_w[2] * e_w[0], 0.0)
    coupling = cross(w, w_d)
    gyroscopic = cross(w, (J[0] * w[0], J[1] * w[1], J[2] * w[2]))
    # Equations (15) and (16).
    moment = np.empty(3)
    for i in range(3):
        turn = -k_R[i] * e_R[i] - k_w[i] * e_w[i] - turning[i] - coupling[i] + alpha_d[i]
        moment[i] = J[i] * turn + gyroscopic[i]
    x, y, z = turned_back(moment, ROTOR_DELAY * w[2])
    return np.array([mass * max(dot(force, R[2]), 0.0), x, y, z])


@compiled
def _command(commands, thrusts, speeds, rotors, gains):
    """Sets the speeds to command for thrusts (N), all (n,); those of lost rotors are zero.

    Args:
        speeds: of the rotors now (rad/s), (n,). rotors, gains: see the head of this file.
    """
    for i in range(len(commands)):
        wanted = math.sqrt(thrusts[i] / rotors[i, _C_F])
        faster = speeds[i] + gains[_OVERDRIVE] * (wanted - speeds[i])
        works = rotors[i, _LIMIT] > 0.0 and faster > 0.0  # NaN is not
        commands[i] = min(faster, rotors[i, _MAX_SPEED]) if works else 0.0


@compiled
def _command_wrench(commands, wrench, speeds, rotors, gains):
    """Likewise for a wrench, (4,); returns False if it is not possible, and changes nothing."""
    thrusts, possible = by_inverse(rotors[:, _INVERSE], wrench, rotors[:, _LIMIT])
    if possible:
        _command(commands, thrusts, speeds, rotors, gains)
    return possible


@compilable
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
