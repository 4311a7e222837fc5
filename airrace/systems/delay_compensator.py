"""The state at the time at which a command will arrive, over a link that takes its time."""

import math

import numpy as np
from pydrake.systems.framework import LeafSystem

from airrace.systems import state_estimate as se
from airrace.triples import columns, cross
from airrace.vehicle import GRAVITY, Vehicle

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

    For state_estimate see state_estimate.py, the others have one speed a rotor
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
        self._mass, self._J = vehicle.mass, list(map(float, vehicle.inertia))
        self._allocation = (vehicle.allocation * vehicle.thrust_coefficients).tolist()
        self._max_speeds = vehicle.max_speeds.tolist()
        self._blend = 1.0 - math.exp(-self._period / vehicle.rotor_lag)
        self._estimate = self.DeclareVectorInputPort("state_estimate", se.SIZE)
        self._speeds = self.DeclareVectorInputPort("rotor_speeds", n)
        self._command = self.DeclareVectorInputPort("rotor_speed_command", n)
        # Commands, newest first, and since when the newest is in force (s).
        self._depth = math.ceil(_MOST * rate) + 1
        self._history = self.DeclareDiscreteState(self._depth * n)
        self._since = self.DeclareDiscreteState(1)
        self._delay = self.DeclareDiscreteState(1)
        self.DeclarePeriodicDiscreteUpdateEvent(self._period, 0.0, self._Remember)
        inputs = {self._estimate.ticket(), self._speeds.ticket(), self.xd_ticket()}
        self.DeclareVectorOutputPort(
            "state_estimate", se.SIZE,
            lambda context, output: output.set_value(self._Predicted(context)[0]), inputs)
        self.DeclareVectorOutputPort(
            "rotor_speeds", n,
            lambda context, output: output.set_value(self._Predicted(context)[1]), inputs)

    def SetDelay(self, context, delay: float) -> None:
        """Sets the delay, there and back (s): whole periods."""
        context.SetDiscreteState(self._delay, [min(delay, _MOST)])

    def Rounded(self, delay: float, before: float) -> float:
        """Returns the delay to use (s): whole periods, and another one only if it matters.

        Args:
            delay: measured (s).
            before: used so far (s).
        """
        if abs(delay - before) < _LEAST:
            return before
        return 0.0 if delay < _LEAST else self._period * math.ceil(delay / self._period)

    def _Remember(self, context, discrete_state):
        history = context.get_discrete_state(self._history).value()
        command = self._command.Eval(context)
        discrete_state.set_value(
            self._history, np.concatenate([command, history[:-len(command)]]))
        # What is seen now was made one period ago.
        discrete_state.set_value(self._since, [context.get_time() - self._period])

    def _Predicted(self, context):
        """Returns the two outputs."""
        estimate, speeds = self._estimate.Eval(context), self._speeds.Eval(context)
        delay = context.get_discrete_state(self._delay).value()[0]
        if delay < _LEAST or not np.isfinite(estimate).all():
            return estimate, speeds
        n = len(speeds)
        history = context.get_discrete_state(self._history).value().reshape(self._depth, n)
        since = context.get_discrete_state(self._since).value()[0]
        # The command in force at the time of the estimate, and those after it.
        first = min(max(math.floor((since - estimate[se.TIME]) / self._period) + 1, 0),
                    self._depth - 1)
        steps = round(delay / self._period)
        commands = [history[max(first - k, 0)].tolist() for k in range(steps)]
        wanted = history[first:first + _WHILE].min(axis=0)
        predicted, carried = self._carried(estimate.tolist(), speeds.tolist(), commands, delay)
        return predicted, np.where(speeds < _FOLLOWS * wanted, speeds, carried)

    def _carried(self, estimate, speeds, commands, delay):
        h, mass, (J_x, J_y, J_z) = self._period, self._mass, self._J
        x, y, z = estimate[se.POSITION]
        vx, vy, vz = estimate[se.VELOCITY]
        q = estimate[se.QUATERNION]
        R = columns(*q)
        p, s, r = (sum(a * b for a, b in zip(estimate[se.ANGULAR_VELOCITY], axis)) for axis in R)
        thrust = sum(a * w * w for a, w in zip(self._allocation[0], speeds))
        flying = thrust > _FLYING * mass * GRAVITY
        for command in commands:
            speeds = [
                w + self._blend * (min(max(c, 0.0), limit) - w)
                for w, c, limit in zip(speeds, command, self._max_speeds)]
            if not flying:
                continue
            squares = [w * w for w in speeds]
            thrust, *moment = (sum(a * b for a, b in zip(row, squares))
                               for row in self._allocation)
            gx, gy, gz = cross((p, s, r), (J_x * p, J_y * s, J_z * r))
            p += h * (moment[0] - gx) / J_x
            s += h * (moment[1] - gy) / J_y
            r += h * (moment[2] - gz) / J_z
            a, b, c = 0.5 * h * p, 0.5 * h * s, 0.5 * h * r
            q0, q1, q2, q3 = q
            q = (q0 - q1 * a - q2 * b - q3 * c, q1 + q0 * a + q2 * c - q3 * b,
                 q2 + q0 * b + q3 * a - q1 * c, q3 + q0 * c + q1 * b - q2 * a)
            length = math.sqrt(sum(part * part for part in q))
            q = tuple(part / length for part in q)
            R = columns(*q)
            up = R[2]
            x, y, z = x + h * vx, y + h * vy, z + h * vz
            vx += h * thrust / mass * up[0]
            vy += h * thrust / mass * up[1]
            vz += h * (thrust / mass * up[2] - GRAVITY)
        w_W = [p * i + s * j + r * k for i, j, k in zip(*R)]
        predicted = [estimate[se.TIME] + delay, *q, x, y, z, *w_W, vx, vy, vz]
        return np.array(predicted), np.array(speeds)
