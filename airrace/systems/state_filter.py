"""Smooths the state estimate for the controller, and finds what pushes the drone."""

import numpy as np
from pydrake.math import DiscreteAlgebraicRiccatiEquation
from pydrake.systems.framework import LeafSystem

from airrace.systems import state_estimate as se
from airrace.vehicle import GRAVITY, Vehicle

# What the filter is tuned for; the first two are the reference system's noise.
_POSITION_SIGMA = 0.005  # m
_VELOCITY_SIGMA = 0.3  # m/s, 3 % of 10 m/s
_ACCELERATION_NOISE = 0.1  # m/s^2 / sqrt(Hz), of the rotors' thrust
_DISTURBANCE_NOISE = 0.7  # m/s^2 / sqrt(s), how fast the disturbance wanders
_MAX_DISTURBANCE = 8.0  # m/s^2
_FLYING = 0.5  # of the weight: with less thrust, the ground may carry the drone

# The memory: time, time of the newest estimate, position, velocity, disturbance.
_NOW, _NEWEST, _MOTION = 0, 1, slice(2, 11)


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
        self.DeclareDiscreteState([-1.0, -1.0, *np.zeros(9)])
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / rate, 0.0, self._Update)
        self.DeclareVectorOutputPort("filtered_estimate", se.SIZE, self._CalcEstimate)
        self.DeclareVectorOutputPort(
            "disturbance", 3, self._CalcDisturbance, {self.xd_ticket()}
        )

    def _Update(self, context, discrete_state):
        memory = context.get_discrete_state_vector().value()
        estimate = self._estimate.Eval(context)
        if not np.isfinite(estimate).all():
            return  # the prediction goes on from the last that was
        time = estimate[se.TIME]
        if memory[_NEWEST] < 0.0:
            motion = np.array([estimate[se.POSITION], estimate[se.VELOCITY], np.zeros(3)])
        elif time > memory[_NEWEST]:
            motion, thrust = self._Predict(context, memory, estimate, time)
            measured = np.array([estimate[se.POSITION], estimate[se.VELOCITY]])
            motion += self._gain @ (measured - motion[:2])
            if thrust < _FLYING * GRAVITY:
                motion[2] = memory[_MOTION][6:]
            motion[2] *= min(1.0, _MAX_DISTURBANCE / max(np.linalg.norm(motion[2]), 1e-9))
        else:
            time = context.get_time()
            motion, _ = self._Predict(context, memory, estimate, time)
        newest = max(memory[_NEWEST], estimate[se.TIME])
        discrete_state.set_value(np.concatenate([[time, newest], motion.ravel()]))

    def _Predict(self, context, memory, estimate, time):
        """Returns position, velocity and disturbance at a time, (3, 3), and the thrust.

        The thrust is per mass (m/s^2).
        """
        p, v, d = memory[_MOTION].reshape(3, 3)
        dt = time - memory[_NOW]
        speeds = np.nan_to_num(self._speeds.Eval(context), nan=0.0, posinf=0.0, neginf=0.0)
        thrust = (self._thrust_per_mass * speeds).dot(speeds)
        w, x, y, z = predict_quaternion(estimate, time).tolist()
        up = np.array([2 * (w * y + x * z), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
        a = thrust * up + d
        a[2] -= GRAVITY
        return np.array([p + dt * (v + (0.5 * dt) * a), v + dt * a, d]), thrust

    def _CalcEstimate(self, context, output):
        memory = context.get_discrete_state_vector().value()
        estimate = self._estimate.Eval(context).copy()
        if memory[_NEWEST] >= 0.0 and np.isfinite(estimate).all():
            time = context.get_time()
            motion, _ = self._Predict(context, memory, estimate, time)
            estimate[se.QUATERNION] = predict_quaternion(estimate, time)
            estimate[se.POSITION], estimate[se.VELOCITY] = motion[:2]
            estimate[se.TIME] = time
        output.set_value(estimate)

    def _CalcDisturbance(self, context, output):
        output.set_value(context.get_discrete_state_vector().value()[_MOTION][6:])


def predict_quaternion(estimate, time: float) -> np.ndarray:
    """Returns the unit quaternion of R_WB a short time after a state estimate, (4,).

    Args:
        estimate: vector of state_estimate.py, (14,).
        time: (s).
    """
    w, x, y, z = estimate[se.QUATERNION].tolist()
    a, b, c = ((time - estimate[se.TIME]) / 2 * estimate[se.ANGULAR_VELOCITY]).tolist()
    # The product of 1 + [a, b, c] / 1, which is normalised, and the quaternion.
    q = np.array([
        w - a * x - b * y - c * z,
        x + a * w + b * z - c * y,
        y + b * w + c * x - a * z,
        z + c * w + a * y - b * x,
    ])
    return q / np.sqrt(q.dot(q))


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
