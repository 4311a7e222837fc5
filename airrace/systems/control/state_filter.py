"""Smooths the state estimate for the controller, and finds what pushes the drone."""

import math

import numpy as np
from pydrake.math import DiscreteAlgebraicRiccatiEquation
from pydrake.systems.framework import LeafSystem

from airrace.common.jit import all_finite, compilable, compiled
from airrace.math.vec3 import columns, dot, triple
from airrace.systems.ports import read_vector
from airrace.vehicle import GRAVITY, Vehicle
from airrace.vehicle.state import STATE_SIZE, as_state

# What the filter is tuned for; the first two are the reference system's noise.
_POSITION_SIGMA = 0.005  # m
_VELOCITY_SIGMA = 0.3  # m/s, 3 % of 10 m/s
_ACCELERATION_NOISE = 0.1  # m/s^2 / sqrt(Hz), of the rotors' thrust
_DISTURBANCE_NOISE = 0.7  # m/s^2 / sqrt(s), how fast the disturbance wanders
_MAX_DISTURBANCE = 8.0  # m/s^2
_GAP = 0.1  # s without an estimate, after which the filter begins anew
_FLYING = 0.5  # of the weight: with less thrust, the ground may carry the drone

# The memory: time, time of the newest estimate, position, velocity, and what carries them
# on: the thrust per mass and the disturbance, all in one vector because it is handed over
# at every tick.
_NOW, _NEWEST, _MOTION, _THRUST, _PUSH = 0, 1, slice(2, 8), 8, slice(9, 12)
_NOTHING = np.array([-1.0, -1.0, *10 * [0.0]])


class StateFilter(LeafSystem):
    """A steady-state Kalman filter of position, velocity and disturbance.

    .. pydrake_system::

        name: StateFilter
        input_ports:
        - state_estimate
        - rotor_speeds
        output_ports:
        - filtered_estimate
        - disturbance

    ``state_estimate`` and ``filtered_estimate``: see vehicle/state.py;
    ``rotor_speeds`` as reported (rad/s); ``disturbance`` (3) is the acceleration
    that rotors and gravity do not explain, by wind, drag, or a wrong mass (m/s^2,
    in the world).

    Noise on the velocity does not average out in flight: rotors answer with
    the square of a lagged speed, so that jitter in their command costs mean
    thrust. The filter predicts with the thrust of the rotors as they turn, so
    it holds in a tumble as it does on a trajectory, and a disturbance cannot
    wind up while they are at their limits. The outputs are carried forward from
    the newest estimate to the present, the attitude by its angular velocity.
    """

    def __init__(self, *, vehicle: Vehicle, state_rate: float, rate: float):
        """Constructs the filter.

        Args:
            vehicle: mass and rotors.
            state_rate: of the state estimate (Hz).
            rate: how often it looks for a new one (Hz).
        """
        LeafSystem.__init__(self)
        self._gain = kalman_gain(1.0 / state_rate)
        self._thrust_per_mass = vehicle.thrust_coefficients / vehicle.mass
        self._estimate = self.DeclareVectorInputPort("state_estimate", STATE_SIZE)
        self._speeds = self.DeclareVectorInputPort("rotor_speeds", len(vehicle.rotors))
        self._memory = self.DeclareDiscreteState(_NOTHING)
        self._disturbance = self.DeclareDiscreteState(3)
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / rate, 0.0, self._update)
        self.DeclareVectorOutputPort("filtered_estimate", STATE_SIZE, self._calc_estimate)
        self.DeclareStateOutputPort("disturbance", self._disturbance)

    def _update(self, context, discrete_state):
        _update(
            discrete_state.get_mutable_value(self._memory),
            discrete_state.get_mutable_value(self._disturbance),
            read_vector(self._estimate, context),
            read_vector(self._speeds, context),
            self._thrust_per_mass,
            self._gain,
            context.get_time(),
        )

    def _calc_estimate(self, context, output):
        estimate = self._estimate.Eval(context)
        _carry_forward(
            estimate, context.get_discrete_state(self._memory).value(), context.get_time()
        )
        output.set_value(estimate)


@compilable
def _thrust(speeds, coefficients) -> float:
    """Returns the thrust per mass of the rotors that report a speed (m/s^2)."""
    thrust = 0.0
    for i in range(len(speeds)):
        if math.isfinite(speeds[i]):
            thrust += coefficients[i] * speeds[i] * speeds[i]
    return thrust


@compilable
def _move(motion, quaternion, thrust, disturbance, dt):
    """Carries position and velocity, (6,), forward.

    Args:
        quaternion: of R_WB, (4,).
        thrust: per mass (m/s^2). disturbance: see StateFilter.
        dt: (s).
    """
    _, _, up = columns(*quaternion)
    for i in range(3):
        a = thrust * up[i] + disturbance[i] - (GRAVITY if i == 2 else 0.0)
        p, v = motion[i], motion[3 + i]
        motion[i], motion[3 + i] = p + dt * (v + 0.5 * dt * a), v + dt * a


@compiled
def _carry_forward(estimate, memory, time):
    """Makes the estimate for a time of the newest one, (14,), which stays if it is not finite."""
    if memory[_NEWEST] < 0.0 or not all_finite(estimate):
        return
    quaternion, motion = predict_quaternion(estimate, time), memory[_MOTION].copy()
    _move(motion, quaternion, memory[_THRUST], memory[_PUSH], time - memory[_NOW])
    state = as_state(estimate)
    estimate[0] = time
    for i in range(4):
        state.quaternion[i] = quaternion[i]
    state.position[:], state.velocity[:] = motion[:3], motion[3:]


@compiled
def _update(memory, disturbance, estimate, speeds, coefficients, gain, now):
    """Takes in an estimate, if it is new; else goes on to the present.

    Args:
        memory, disturbance: changed; see StateFilter.
        estimate: (14,).
        speeds: of the rotors, as reported (rad/s), (n,).
        coefficients: of their thrusts per mass, (n,).
        gain: see kalman_gain().
        now: (s).
    """
    if not all_finite(estimate):
        return  # the prediction goes on from the last that was
    time, motion, thrust = as_state(estimate).time, memory[_MOTION], _thrust(speeds, coefficients)
    is_new, begins = time > memory[_NEWEST], memory[_NEWEST] < 0.0 or time > memory[_NEWEST] + _GAP
    if begins:
        motion[:3], motion[3:] = as_state(estimate).position, as_state(estimate).velocity
    else:
        until = time if is_new else now
        _move(
            motion, predict_quaternion(estimate, until), thrust, disturbance, until - memory[_NOW]
        )
        if is_new:
            _correct(motion, disturbance, estimate, thrust >= _FLYING * GRAVITY, gain)
    memory[_THRUST], memory[_PUSH] = thrust, disturbance
    memory[_NOW] = time if is_new or begins else now
    memory[_NEWEST] = max(time, memory[_NEWEST])


@compilable
def _correct(motion, disturbance, estimate, flying, gain):
    """Corrects position, velocity and, if it flies, disturbance by an estimate of that time."""
    state = as_state(estimate)
    for i in range(3):
        e_p = state.position[i] - motion[i]
        e_v = state.velocity[i] - motion[3 + i]
        motion[i] = motion[i] + gain[0, 0] * e_p + gain[0, 1] * e_v
        motion[3 + i] = motion[3 + i] + gain[1, 0] * e_p + gain[1, 1] * e_v
        if flying:
            disturbance[i] += gain[2, 0] * e_p + gain[2, 1] * e_v
    length = math.sqrt(dot(disturbance, disturbance))
    for i in range(3):
        disturbance[i] *= min(1.0, _MAX_DISTURBANCE / max(length, 1e-9))


@compilable
def predict_quaternion(estimate, time: float) -> tuple:
    """Returns the unit quaternion of R_WB a short time after a state estimate, (4,).

    Args:
        estimate: of vehicle/state.py, (14,).
        time: (s).
    """
    w, x, y, z = estimate[1], estimate[2], estimate[3], estimate[4]
    half = (time - as_state(estimate).time) / 2
    a, b, c = triple(as_state(estimate).angular_velocity, 0)
    a, b, c = half * a, half * b, half * c
    # The product of 1 + [a, b, c] / 1, which is normalised, and the quaternion.
    q = (
        w - a * x - b * y - c * z,
        x + a * w + b * z - c * y,
        y + b * w + c * x - a * z,
        z + c * w + a * y - b * x,
    )
    length = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return q[0] / length, q[1] / length, q[2] / length, q[3] / length


def kalman_gain(dt: float) -> np.ndarray:
    """Returns the steady-state gain on errors of position and velocity, (3, 2).

    Its rows correct position, velocity and disturbance.

    Args:
        dt: between two estimates (s).
    """
    A = np.array([[1.0, dt, dt * dt / 2], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])
    # Of white noise all through dt; if held over dt, Q would be singular, and
    # by rounding not even positive semidefinite.
    Q = np.zeros((3, 3))
    for order, density in ((2, _ACCELERATION_NOISE), (3, _DISTURBANCE_NOISE)):
        powers = np.arange(order)[::-1]
        factorials = np.array([1.0, 1.0, 2.0])[powers]
        sums = powers[:, None] + powers + 1
        Q[:order, :order] += density**2 * dt**sums / sums / np.outer(factorials, factorials)
    R = np.diag([_POSITION_SIGMA**2, _VELOCITY_SIGMA**2])
    C = np.eye(3)[:2]
    # The filter's Riccati equation is the regulator's of the transposed system.
    P = DiscreteAlgebraicRiccatiEquation(A.T, C.T, Q, R)
    return P @ C.T @ np.linalg.inv(C @ P @ C.T + R)
