"""Smooths the state estimate for the controller, and finds what pushes the drone."""

import math

import numpy as np
from pydrake.math import DiscreteAlgebraicRiccatiEquation
from pydrake.systems.framework import LeafSystem

from airrace.compiled import all_finite, compilable, compiled
from airrace.systems import state_estimate as se
from airrace.triples import columns, dot, triple
from airrace.vehicle import GRAVITY, Vehicle

# What the filter is tuned for; the first two are the reference system's noise.
_POSITION_SIGMA = 0.005  # m
_VELOCITY_SIGMA = 0.3  # m/s, 3 % of 10 m/s
_ACCELERATION_NOISE = 0.1  # m/s^2 / sqrt(Hz), of the rotors' thrust
_DISTURBANCE_NOISE = 0.7  # m/s^2 / sqrt(s), how fast the disturbance wanders
_MAX_DISTURBANCE = 8.0  # m/s^2
_GAP = 0.1  # s without an estimate, after which the filter begins anew
_FLYING = 0.5  # of the weight: with less thrust, the ground may carry the drone

# The memory: time, time of the newest estimate, position, velocity.
_NOW, _NEWEST, _MOTION = 0, 1, slice(2, 8)


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

    ``state_estimate`` and ``filtered_estimate``: see state_estimate.py;
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
        self._estimate = self.DeclareVectorInputPort("state_estimate", se.SIZE)
        self._speeds = self.DeclareVectorInputPort("rotor_speeds", len(vehicle.rotors))
        self._memory = self.DeclareDiscreteState([-1.0, -1.0, *np.zeros(6)])
        self._disturbance = self.DeclareDiscreteState(3)
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / rate, 0.0, self._Update)
        self._filtered = self.DeclareVectorOutputPort(
            "filtered_estimate", se.SIZE, self._CalcEstimate)
        self.DeclareStateOutputPort("disturbance", self._disturbance)

    def _Update(self, context, discrete_state):
        memory = context.get_discrete_state(self._memory).value()
        estimate = self._estimate.Eval(context)
        if not all_finite(estimate):
            return  # the prediction goes on from the last that was
        after = np.empty_like(memory)
        after[_NOW], after[_NEWEST] = estimate[se.TIME], max(estimate[se.TIME], memory[_NEWEST])
        if memory[_NEWEST] < 0.0 or estimate[se.TIME] > memory[_NEWEST] + _GAP:
            after[_MOTION] = [*estimate[se.POSITION], *estimate[se.VELOCITY]]
        elif estimate[se.TIME] > memory[_NEWEST]:
            after[_MOTION], disturbance = _corrected(
                memory, estimate, *self._Push(context), self._gain)
            discrete_state.set_value(self._disturbance, disturbance)
        else:
            # As the output has it, which others have asked for already.
            filtered = self._filtered.Eval(context)
            after[_NOW] = filtered[se.TIME]
            after[_MOTION] = [*filtered[se.POSITION], *filtered[se.VELOCITY]]
        discrete_state.set_value(self._memory, after)

    def _CalcEstimate(self, context, output):
        memory = context.get_discrete_state(self._memory).value()
        estimate = self._estimate.Eval(context)
        if memory[_NEWEST] >= 0.0 and all_finite(estimate):
            estimate = _carried_forward(
                memory, estimate, *self._Push(context), context.get_time())
        output.set_value(estimate)

    def _Push(self, context) -> tuple:
        """Returns what accelerates the drone but gravity: thrust per mass, and disturbance."""
        thrust = _thrust_per_mass(self._speeds.Eval(context), self._thrust_per_mass)
        return thrust, context.get_discrete_state(self._disturbance).value()


@compiled
def _thrust_per_mass(speeds, coefficients) -> float:
    """Returns the thrust per mass of the rotors that report a speed (m/s^2)."""
    thrust = 0.0
    for i in range(len(speeds)):
        if math.isfinite(speeds[i]):
            thrust += coefficients[i] * speeds[i] * speeds[i]
    return thrust


@compilable
def _motion(memory, quaternion, thrust, disturbance, time):
    """Returns position and velocity at a time, (6,), carried forward from the memory's."""
    _, _, up = columns(*quaternion)
    motion, dt = np.empty(6), time - memory[_NOW]
    for i in range(3):
        a = thrust * up[i] + disturbance[i] - (GRAVITY if i == 2 else 0.0)
        p, v = memory[_MOTION.start + i], memory[_MOTION.start + 3 + i]
        motion[i], motion[3 + i] = p + dt * (v + 0.5 * dt * a), v + dt * a
    return motion


@compiled
def _carried_forward(memory, estimate, thrust, disturbance, time):
    """Returns the estimate for a time, (14,)."""
    quaternion = predict_quaternion(estimate, time)
    motion = _motion(memory, quaternion, thrust, disturbance, time)
    result = estimate.copy()
    result[se.TIME] = time
    for i in range(4):
        result[se.QUATERNION.start + i] = quaternion[i]
    for i in range(3):
        result[se.POSITION.start + i] = motion[i]
        result[se.VELOCITY.start + i] = motion[3 + i]
    return result


@compiled
def _corrected(memory, estimate, thrust, disturbance, gain):
    """Returns position and velocity at the time of a new estimate, (6,); disturbance, (3,)."""
    time = estimate[se.TIME]
    motion = _motion(memory, predict_quaternion(estimate, time), thrust, disturbance, time)
    after, found = np.empty(6), disturbance.copy()
    for i in range(3):
        e_p = estimate[se.POSITION.start + i] - motion[i]
        e_v = estimate[se.VELOCITY.start + i] - motion[3 + i]
        after[i] = motion[i] + gain[0, 0] * e_p + gain[0, 1] * e_v
        after[3 + i] = motion[3 + i] + gain[1, 0] * e_p + gain[1, 1] * e_v
        if thrust >= _FLYING * GRAVITY:
            found[i] += gain[2, 0] * e_p + gain[2, 1] * e_v
    length = math.sqrt(dot(found, found))
    return after, min(1.0, _MAX_DISTURBANCE / max(length, 1e-9)) * found


@compilable
def predict_quaternion(estimate, time: float) -> tuple:
    """Returns the unit quaternion of R_WB a short time after a state estimate, (4,).

    Args:
        estimate: of state_estimate.py, (14,).
        time: (s).
    """
    w, x, y, z = estimate[1], estimate[2], estimate[3], estimate[4]
    half = (time - estimate[se.TIME]) / 2
    a, b, c = triple(estimate, se.ANGULAR_VELOCITY.start)
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
