"""Geometric tracking control on SE(3)."""

import functools
import math
from typing import Any, NamedTuple

import numpy as np
from pydrake.systems.framework import LeafSystem

from airrace.common.jit import all_finite, assign, compilable, compiled
from airrace.math.quaternion import rotation_matrix
from airrace.math.vec3 import cross, dot, from_columns, rotate
from airrace.systems.control.attitude_error import attitude_error, lead_moment
from airrace.systems.control.reduced_attitude import ROTOR_DELAY, ReducedAttitude
from airrace.systems.ports import read_vector
from airrace.trajopt.flatness import attitude_from_force, heading_vectors
from airrace.trajopt.reference import REFERENCE_SIZE, Reference, as_reference
from airrace.vehicle import GRAVITY, GRAVITY_W, Vehicle
from airrace.vehicle.allocation import by_inverse
from airrace.vehicle.rotor_loss import Remaining
from airrace.vehicle.state import STATE_SIZE, State, as_state

_THRUST_SHARE = 0.95  # of what the rotors have: the rest is for the attitude
_LEAST_LIFT = 0.2 * GRAVITY  # m/s^2, so that errors never ask to point down
_YAW_REACH = 0.25  # rad, an error in yaw that takes all that the rotors have for it
_SHORT_LAG = 0.01  # s, the rotors' apparent lag under overdriven commands
_NONE = np.zeros(3)  # no disturbance, and no motion


class ControlParameters(NamedTuple):
    """The vehicle and its gains, as lee_wrench() takes them.

    Attributes:
        mass: (kg). inertia: principal moments in B (kg m^2), (3,).
        k_x, k_v: gains on errors in position (1/s^2) and velocity (1/s), per mass.
        k_R, k_w: gains on errors in attitude (1/s^2) and angular velocity (1/s), per
            moment of inertia, (3,).
        max_force: the greatest specific force to ask for (m/s^2).
    """

    mass: float
    inertia: np.ndarray
    k_x: float
    k_v: float
    k_R: np.ndarray
    k_w: np.ndarray
    max_force: float


@compilable
def _as_parameters(vector: np.ndarray) -> ControlParameters:
    v = vector
    return ControlParameters(v[0], v[1:4], v[4], v[5], v[6:9], v[9:12], v[12])


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

    ``reference``: a trajopt.Reference (18); ``filtered_estimate``: a vehicle.State
    (14); ``disturbance``: an acceleration to lean against (m/s^2,
    in the world), see StateFilter; ``rotor_speeds`` as reported, and
    ``rotor_speed_command``, held over the period: one speed a rotor (rad/s);
    ``rotor_losses``: see RotorMonitor.

    The desired angular velocity and acceleration come from the jerk and snap
    of the reference; the derivatives of the feedback terms, which would need
    the acceleration of the drone, are left out. Commands of rotor
    speeds overshoot, so that the rotors reach the desired speeds sooner.

    With rotors lost, the wrench is allocated to the rest. If those cannot hold
    the yaw, the controller ignores the reference and descends: see ReducedAttitude.
    While an input is not finite, the last command is held.
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
        self._feed_forward = feed_forward
        self._rejects = disturbance_rejection
        self._remaining = functools.cache(
            lambda losses: Remaining(vehicle, np.isinf(np.frombuffer(losses)))
        )
        max_lift = self._remaining(np.full(n, np.inf).tobytes()).max_lift
        k_R, k_w = _attitude_gains(vehicle)
        parameters = ControlParameters(
            mass=vehicle.mass,
            inertia=np.array(vehicle.inertia),
            k_x=vehicle.gains.position,
            k_v=vehicle.gains.velocity,
            k_R=k_R,
            k_w=k_w,
            max_force=_THRUST_SHARE * max_lift / vehicle.mass,
        )
        self._parameters = np.hstack(parameters)  # quicker to hand over, see common/jit.py
        self._thrust_coefficients = vehicle.thrust_coefficients
        self._max_speeds = vehicle.max_speeds
        self._overdrive = _step_share(rate, min(_SHORT_LAG, vehicle.rotor_lag)) / _step_share(
            rate, vehicle.rotor_lag
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
        remaining = self._remaining(read_vector(self._losses, context).tobytes())
        estimate, disturbance = read_vector(self._estimate, context), _NONE
        if self._rejects:
            disturbance = read_vector(self._disturbance, context)
        if remaining.can_fly:
            reference = self._reference.Eval(context)
            _lean(reference, disturbance, self._feed_forward)
            wrench = self.calc_wrench(reference, estimate)
        elif all_finite(estimate) and all_finite(disturbance):
            wrench = self._reduced.wrench(estimate, disturbance, remaining)
        else:
            return
        allocator, command = remaining.allocator, discrete_state.get_mutable_value()
        rotors = (
            read_vector(self._speeds, context),
            remaining.max_thrusts,
            self._thrust_coefficients,
            self._max_speeds,
            self._overdrive,
        )
        if allocator.is_complete and _set_by_inverse(command, wrench, allocator.inverse, *rotors):
            return  # no rotor is at a limit, as nearly always
        if all_finite(wrench):
            _set_speeds(command, allocator.allocate(wrench), *rotors)

    def calc_wrench(self, reference: np.ndarray, estimate: np.ndarray) -> np.ndarray:
        """Returns total thrust (N) and moments in B (N m), [f, Mx, My, Mz], (4,).

        The result is NaN where an argument is not finite: then the last command is held.

        Args:
            reference: vector of a Reference, (18,), that leans against the disturbance.
            estimate: vector of a State, (14,).
        """
        return _wrench(reference, estimate, self._parameters)


@compiled
def _lean(reference, disturbance, feed_forward):
    """Makes a reference, (18,), lean against a disturbance (m/s^2); see GeometricController."""
    _, _, acceleration, jerk, snap, _, _, _ = as_reference(reference)
    acceleration -= disturbance
    if not feed_forward:
        assign(jerk, _NONE)
        assign(snap, _NONE)
        assign(reference[-2:], _NONE)  # the derivatives of yaw


@compiled
def _wrench(reference, estimate, parameters):
    if not (all_finite(reference) and all_finite(estimate)):
        return np.full(4, np.nan)
    return lee_wrench(as_reference(reference), as_state(estimate), _as_parameters(parameters))


@compilable
def lee_wrench(reference: Reference, state: State, parameters: ControlParameters) -> np.ndarray:
    """Returns total thrust (N) and moments in B (N m), [f, Mx, My, Mz], (4,).

    They are equations (15) and (16) of Lee, Leok, McClamroch (CDC 2010), with gains per
    mass and inertia, and two changes: e_R is attitude_error(), and the damping of roll and
    pitch does not turn with a spin that is yet to be stopped.

    Args:
        reference: D, the desired motion. state: of the body B. parameters: of the vehicle.
    """
    mass, J, k_x, k_v, k_R, k_w, max_force = parameters
    force = limited(
        k_x * (reference.position - state.position)
        + k_v * (reference.velocity - state.velocity)
        + reference.acceleration
        - GRAVITY_W,
        max_force,
    )
    # Equation (23), and the derivatives of that attitude.
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
    R_BD = from_columns(rotate(R_BW, x_D), rotate(R_BW, y_D), rotate(R_BW, z_D))
    w = rotate(R_BW, state.angular_velocity)
    w_d, alpha_d = rotate(R_BD, w_D), rotate(R_BD, alpha_D)
    e_R, e_w = attitude_error(R_BD.T, w), w - w_d
    spin = np.array((-e_w[2] * e_w[1], e_w[2] * e_w[0], 0.0))
    alpha = -k_R * e_R - k_w * e_w - spin - cross(w, w_d) + alpha_d
    Mx, My, Mz = lead_moment(J * alpha + cross(w, J * w), ROTOR_DELAY * w[2])
    thrust = mass * max(dot(force, R_WB[:, 2]), 0.0)
    return np.array((thrust, Mx, My, Mz))


@compilable
def limited(force: np.ndarray, greatest: float) -> np.ndarray:
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
    return np.array((share * x, share * y, z))


@compiled
def _set_by_inverse(
    command: np.ndarray,
    wrench: np.ndarray,
    inverse: np.ndarray,
    speeds: np.ndarray,
    max_thrusts: np.ndarray,
    *rotors: Any,
) -> bool:
    """Sets the speeds for a wrench by the pseudo-inverse; returns whether the limits allow it."""
    thrusts, possible = by_inverse(inverse, wrench, max_thrusts)
    if possible:
        _set_speeds(command, thrusts, speeds, max_thrusts, *rotors)
    return possible


@compiled
def _set_speeds(command, thrusts, speeds, max_thrusts, thrust_coefficients, max_speeds, overdrive):
    """Sets the speeds to command (rad/s), (n,), for thrusts (N), (n,).

    Rotors answer late, so that the command goes beyond the speed that they should have.
    Those that are lost, or report no speed, are not driven.
    """
    for i in range(len(command)):
        desired = math.sqrt(thrusts[i] / thrust_coefficients[i])
        overdriven = speeds[i] + overdrive * (desired - speeds[i])
        works = max_thrusts[i] > 0.0 and overdriven > 0.0  # NaN is not
        command[i] = min(overdriven, max_speeds[i]) if works else 0.0


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


def _step_share(rate: float, lag: float) -> float:
    """Returns how much of a step a first-order lag makes in one period."""
    return 1.0 - math.exp(-1.0 / (rate * lag))
