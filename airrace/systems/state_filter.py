"""Smooths the state estimate for the controller."""

import numpy as np
from pydrake.math import DiscreteAlgebraicRiccatiEquation
from pydrake.systems.framework import LeafSystem

from airrace.systems import state_estimate as se
from airrace.trajopt import flat_trajectory as ref

# What the filter is tuned for; the first two are the reference system's noise.
_POSITION_SIGMA = 0.005  # m
_VELOCITY_SIGMA = 0.3  # m/s, 3 % of 10 m/s
_ACCELERATION_NOISE = 0.3  # m/s^2 / sqrt(Hz), of what the reference leaves out


class StateFilter(LeafSystem):
    """A steady-state Kalman filter of position and velocity.

    .. pydrake_system::

        name: StateFilter
        input_ports:
        - state_estimate
        - reference
        output_ports:
        - filtered_estimate

    ``state_estimate`` and ``filtered_estimate``: see state_estimate.py;
    ``reference``: see trajopt/flat_trajectory.py.

    Noise on the velocity does not average out in flight: rotors answer with
    the square of a lagged speed, so that jitter in their command costs mean
    thrust. The filter predicts with the reference's acceleration. Attitude
    and angular velocity pass through. The output is carried forward from the
    newest estimate to the present.
    """

    def __init__(self, *, state_rate: float, rate: float):
        """Constructs the filter.

        Args:
            state_rate: of the state estimate (Hz).
            rate: how often it looks for a new one (Hz).
        """
        LeafSystem.__init__(self)
        self._gain = kalman_gain(1.0 / state_rate)
        self._estimate = self.DeclareVectorInputPort("state_estimate", se.SIZE)
        self._reference = self.DeclareVectorInputPort("reference", ref.SIZE)
        # Time of the newest estimate, position, velocity.
        self.DeclareDiscreteState([-1.0, *np.zeros(6)])
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / rate, 0.0, self._Correct)
        self.DeclareVectorOutputPort("filtered_estimate", se.SIZE, self._CalcEstimate)

    def _Correct(self, context, discrete_state):
        memory = context.get_discrete_state_vector().value()
        estimate = self._estimate.Eval(context)
        if estimate[se.TIME] <= memory[0]:
            return
        measured = np.array([estimate[se.POSITION], estimate[se.VELOCITY]])
        if memory[0] >= 0.0:
            predicted = self._Predict(context, memory, estimate[se.TIME])
            measured = predicted + self._gain @ (measured - predicted)
        discrete_state.set_value([estimate[se.TIME], *measured.ravel()])

    def _Predict(self, context, memory, time):
        """Returns position and velocity at a time, (2, 3)."""
        dt = time - memory[0]
        acceleration = self._reference.Eval(context)[ref.ACCELERATION]
        velocity = memory[4:] + dt * acceleration
        return np.array([memory[1:4] + dt * (memory[4:] + velocity) / 2, velocity])

    def _CalcEstimate(self, context, output):
        memory = context.get_discrete_state_vector().value()
        estimate = self._estimate.Eval(context).copy()
        if memory[0] >= 0.0:
            estimate[se.POSITION], estimate[se.VELOCITY] = self._Predict(
                context, memory, context.get_time()
            )
        output.set_value(estimate)


def kalman_gain(dt: float) -> np.ndarray:
    """Returns the steady-state gain on errors of position and velocity, (2, 2).

    Args:
        dt: between two estimates (s).
    """
    A = np.array([[1.0, dt], [0.0, 1.0]])
    # Of white noise all through dt; if held over dt, Q would be singular, and
    # by rounding not even positive semidefinite.
    Q = _ACCELERATION_NOISE**2 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    R = np.diag([_POSITION_SIGMA**2, _VELOCITY_SIGMA**2])
    # The filter's Riccati equation is the regulator's of the transposed system.
    P = DiscreteAlgebraicRiccatiEquation(A.T, np.eye(2), Q, R)
    return P @ np.linalg.inv(P + R)
