"""The state at the time at which a command will arrive, over a link that takes its time."""

import math

import numpy as np
from pydrake.systems.framework import LeafSystem

from airrace.common.jit import all_finite, compilable, compiled
from airrace.math.vec3 import columns, cross, in_axes, sum3
from airrace.systems.plant.rotor_bank import turn
from airrace.vehicle import GRAVITY, Vehicle
from airrace.vehicle.state import STATE_SIZE, as_state

_LEAST = 0.004  # s, less is not worth the work
_MOST = 0.25  # s, beyond which no model is good enough
_FLYING = 0.5  # of the weight: with less thrust, the ground may carry the drone
_FOLLOWS = 0.6  # of the least speed commanded in a while: a rotor below has stopped
_WHILE = 30  # commands


class DelayCompensator(LeafSystem):
    """Predicts what the drone does while messages are under way.

    .. pydrake_system::

        name: DelayCompensator
        input_ports:
        - state_estimate
        - rotor_speeds
        - rotor_speed_command
        output_ports:
        - state_estimate
        - rotor_speeds

    For state_estimate see vehicle/state.py, the others have one speed a rotor
    (rad/s). The command is the one that is being sent. The outputs are the inputs
    carried forward by the delay there and back: by the rotors' lag and the
    equations of motion of a rigid body, under the commands that have been sent
    and not yet reported upon. So a controller acts on the state that its
    command will meet (O. J. Smith, "Closer control of loops with dead time", 1957).
    A rotor that does not follow its commands is shown as reported.
    """

    def __init__(self, *, vehicle: Vehicle, rate: float):
        """Constructs the compensator, for no delay. Args: rate: of the commands (Hz)."""
        LeafSystem.__init__(self)
        n = len(vehicle.rotors)
        self._period = 1.0 / rate
        self._mass, self._J = float(vehicle.mass), np.array(vehicle.inertia, float)
        self._allocation, self._c_f = vehicle.allocation, vehicle.thrust_coefficients
        self._max_speeds = vehicle.max_speeds
        self._blend = 1.0 - math.exp(-self._period / vehicle.rotor_lag)
        self._estimate = self.DeclareVectorInputPort("state_estimate", STATE_SIZE)
        self._speeds = self.DeclareVectorInputPort("rotor_speeds", n)
        self._command = self.DeclareVectorInputPort("rotor_speed_command", n)
        # Commands, newest first, and since when the newest is in force (s).
        self._depth = math.ceil(_MOST * rate) + 1
        self._history = self.DeclareDiscreteState(self._depth * n)
        self._since = self.DeclareDiscreteState(1)
        self._delay = self.DeclareDiscreteState(1)
        self.DeclarePeriodicDiscreteUpdateEvent(self._period, 0.0, self._remember)
        inputs = {self._estimate.ticket(), self._speeds.ticket(), self.xd_ticket()}
        self.DeclareVectorOutputPort(
            "state_estimate",
            STATE_SIZE,
            lambda context, output: output.set_value(self._predicted(context)[0]),
            inputs,
        )
        self.DeclareVectorOutputPort(
            "rotor_speeds",
            n,
            lambda context, output: output.set_value(self._predicted(context)[1]),
            inputs,
        )

    def set_delay(self, context, delay: float) -> None:
        """Sets the delay, there and back (s), from Rounded()."""
        context.SetDiscreteState(self._delay, [delay])

    def rounded(self, delay: float, before: float) -> float:
        """Returns the delay to use (s): whole periods, another one only if it matters.

        It is never more than a model is good for, 0.25 s, however long the link takes.

        Args:
            delay: measured (s).
            before: used so far (s).
        """
        if abs(delay - before) < _LEAST:
            return before
        if delay < _LEAST:
            return 0.0
        return self._period * math.ceil(min(delay, _MOST) / self._period - 1e-9)

    def _remember(self, context, discrete_state):
        history = discrete_state.get_mutable_value(self._history)
        command = self._command.Eval(context)
        history[len(command) :] = history[: -len(command)]
        history[: len(command)] = command
        # What is seen now was made one period ago.
        discrete_state.get_mutable_value(self._since)[0] = context.get_time() - self._period

    def _predicted(self, context):
        """Returns the two outputs."""
        estimate, speeds = self._estimate.Eval(context), self._speeds.Eval(context)
        delay = context.get_discrete_state(self._delay).value()[0]
        if delay >= _LEAST and all_finite(estimate):
            _predict(
                estimate,
                speeds,
                context.get_discrete_state(self._history).value(),
                context.get_discrete_state(self._since).value()[0],
                delay,
                self._period,
                self._mass,
                self._J,
                self._allocation,
                self._c_f,
                self._max_speeds,
                self._blend,
            )
        return estimate, speeds


@compiled
def _predict(
    estimate, speeds, history, since, delay, period, mass, J, allocation, c_f, max_speeds, blend
):
    """Carries estimate, (14,), and speeds, (n,), forward by a delay (s).

    Args:
        history: commands, newest first, one after the other.
        since: when the newest was made (s).
        the others: see _carry().
    """
    history = history.reshape(-1, len(speeds))
    # The command in force at the time of the estimate, and those after it.
    first = int(math.floor((since - as_state(estimate).time) / period)) + 1
    first = min(max(first, 0), len(history) - 1)
    carried = speeds.copy()
    _carry(
        estimate,
        carried,
        history,
        first,
        int(round(delay / period)),
        period,
        mass,
        J,
        allocation,
        c_f,
        max_speeds,
        blend,
    )
    estimate[0] += delay
    for i in range(len(speeds)):
        wanted = np.min(history[first : first + _WHILE, i])
        if not speeds[i] < _FOLLOWS * wanted:
            speeds[i] = carried[i]


@compilable
def _carry(estimate, speeds, history, first, steps, h, mass, J, allocation, c_f, max_speeds, blend):
    """Carries estimate, (14,), and speeds, (n,), forward by some steps.

    Args:
        history: commands, newest first, (depth, n).
        first: the one in force; it and those after it follow.
        h: a step (s).
        allocation: from the rotors' thrusts to thrust and moments, (4, n).
        c_f, max_speeds, blend: of the rotors, see rotor_bank.turn().
    """
    p, q, v, w = (
        as_state(estimate).position,
        as_state(estimate).quaternion,
        as_state(estimate).velocity,
        as_state(estimate).angular_velocity,
    )
    axes = columns(q[0], q[1], q[2], q[3])
    rates = np.array(in_axes(w, axes))
    thrusts = c_f * speeds**2
    flying = np.sum(allocation[0] * thrusts) > _FLYING * mass * GRAVITY
    for k in range(steps):
        turn(speeds, thrusts, history[max(first - k, 0)], max_speeds, blend, c_f)
        if not flying:
            continue
        wrench, gyro = np.sum(allocation * thrusts, axis=1), cross(rates, J * rates)
        for i in range(3):
            rates[i] += h * (wrench[1 + i] - gyro[i]) / J[i]
        a, b, c = 0.5 * h * rates[0], 0.5 * h * rates[1], 0.5 * h * rates[2]
        q0, q1, q2, q3 = q[0], q[1], q[2], q[3]
        q[0], q[1] = q0 - q1 * a - q2 * b - q3 * c, q1 + q0 * a + q2 * c - q3 * b
        q[2], q[3] = q2 + q0 * b + q3 * a - q1 * c, q3 + q0 * c + q1 * b - q2 * a
        length = math.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
        for i in range(4):
            q[i] /= length
        axes = columns(q[0], q[1], q[2], q[3])
        for i in range(3):
            p[i] += h * v[i]
            v[i] += h * (wrench[0] / mass * axes[2][i] - (GRAVITY if i == 2 else 0.0))
    w[:] = np.array(sum3(rates[0], axes[0], rates[1], axes[1], rates[2], axes[2]))
