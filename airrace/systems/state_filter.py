"""Smooths the state estimate for the controller, and finds what pushes the drone."""

import math

import numpy as np
from pydrake.math import DiscreteAlgebraicRiccatiEquation
from pydrake.systems.framework import LeafSystem

from airrace.systems import state_estimate as se
from airrace.triples import columns
from airrace.vehicle import GRAVITY, Vehicle

# What the filter is tuned for; the first two are the reference system's noise.
_POSITION_SIGMA = 0.005  # m
_VELOCITY_SIGMA = 0.3  # m/s, 3 % of 10 m/s
_ACCELERATION_NOISE = 0.1  # m/s^2 / sqrt(Hz), of the rotors' thrust
_DISTURBANCE_NOISE = 0.7  # m/s^2 / sqrt(s), how fast the disturbance wanders
_MAX_DISTURBANCE = 8.0  # m/s^2
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
        self._gain = kalman_gain(1.0 / state_rate).tolist()
        self._thrust_per_mass = (vehicle.thrust_coefficients / vehicle.mass).tolist()
        self._estimate = self.DeclareVectorInputPort("state_estimate", se.SIZE)
        self._speeds = self.DeclareVectorInputPort("rotor_speeds", len(vehicle.rotors))
        self._memory = self.DeclareDiscreteState([-1.0, -1.0, *np.zeros(6)])
        self._disturbance = self.DeclareDiscreteState(3)
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / rate, 0.0, self._Update)
        self._filtered = self.DeclareVectorOutputPort(
            "filtered_estimate", se.SIZE, self._CalcEstimate)
        self.DeclareStateOutputPort("disturbance", self._disturbance)

    def _Update(self, context, discrete_state):
        # Plain numbers: arrays this small cost more than they spare.
        memory = context.get_discrete_state(self._memory).value().tolist()
        estimate = self._estimate.Eval(context).tolist()
        if not all(map(math.isfinite, estimate)):
            return  # the prediction goes on from the last that was
        time, newest = estimate[se.TIME], memory[_NEWEST]
        if newest < 0.0:
            motion = [*estimate[se.POSITION], *estimate[se.VELOCITY]]
        elif time > newest:
            motion, disturbance = self._Corrected(context, memory, estimate)
            discrete_state.set_value(self._disturbance, np.array(disturbance))
        else:
            # As the output has it, which others have asked for already.
            filtered = self._filtered.Eval(context).tolist()
            time, motion = filtered[se.TIME], [*filtered[se.POSITION], *filtered[se.VELOCITY]]
        newest = max(newest, estimate[se.TIME])
        discrete_state.set_value(self._memory, np.array([time, newest, *motion]))

    def _Corrected(self, context, memory, estimate) -> tuple:
        """Returns position and velocity at the time of a new estimate, (6,); disturbance, (3,)."""
        motion, thrust, _ = self._Predict(context, memory, estimate, estimate[se.TIME])
        held = context.get_discrete_state(self._disturbance).value().tolist()
        motion += held
        measured = [*estimate[se.POSITION], *estimate[se.VELOCITY]]
        errors = [z - x for z, x in zip(measured, motion)]
        p, v, d = (
            [x + by_position * e_p + by_velocity * e_v
             for x, e_p, e_v in zip(motion[i:i + 3], errors[:3], errors[3:])]
            for i, (by_position, by_velocity) in zip((0, 3, 6), self._gain)
        )
        if thrust < _FLYING * GRAVITY:
            d = held
        limit = min(1.0, _MAX_DISTURBANCE / max(math.hypot(*d), 1e-9))
        return [*p, *v], [limit * x for x in d]

    def _Predict(self, context, memory, estimate, time):
        """Carries the memory and the attitude forward.

        Args:
            memory, estimate: lists of numbers.
            time: (s).

        Returns:
            position and velocity, (6,); the thrust per mass (m/s^2); and the
            quaternion of R_WB, (4,).
        """
        thrust = 0.0
        for c, speed in zip(self._thrust_per_mass, self._speeds.Eval(context).tolist()):
            if math.isfinite(speed):
                thrust += c * speed * speed
        quaternion = predict_quaternion(estimate, time)
        *_, (ux, uy, uz) = columns(*quaternion)
        dx, dy, dz = context.get_discrete_state(self._disturbance).value().tolist()
        ax, ay, az = thrust * ux + dx, thrust * uy + dy, thrust * uz + dz - GRAVITY
        x, y, z, vx, vy, vz = memory[_MOTION]
        dt = time - memory[_NOW]
        motion = [
            x + dt * (vx + 0.5 * dt * ax), y + dt * (vy + 0.5 * dt * ay),
            z + dt * (vz + 0.5 * dt * az), vx + dt * ax, vy + dt * ay, vz + dt * az,
        ]
        return motion, thrust, quaternion

    def _CalcEstimate(self, context, output):
        memory = context.get_discrete_state(self._memory).value().tolist()
        estimate = self._estimate.Eval(context).tolist()
        if memory[_NEWEST] >= 0.0 and all(map(math.isfinite, estimate)):
            time = context.get_time()
            motion, _, quaternion = self._Predict(context, memory, estimate, time)
            estimate[se.TIME], estimate[se.QUATERNION] = time, quaternion
            estimate[se.POSITION], estimate[se.VELOCITY] = motion[:3], motion[3:6]
        output.set_value(np.array(estimate))


def predict_quaternion(estimate, time: float) -> tuple:
    """Returns the unit quaternion of R_WB a short time after a state estimate, (4,).

    Args:
        estimate: numbers of state_estimate.py, (14,).
        time: (s).
    """
    w, x, y, z = estimate[se.QUATERNION]
    half = (time - estimate[se.TIME]) / 2
    a, b, c = (half * rate for rate in estimate[se.ANGULAR_VELOCITY])
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
