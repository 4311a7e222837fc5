"""The state at the time at which a command will arrive over a slow link."""

import math
from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import Context

from airrace.common.jit import all_finite, compiled
from airrace.math.small_matrices import apply
from airrace.math.triples import added, integrate
from airrace.systems.estimation.state_filter import FLYING
from airrace.systems.leaf_system import LeafSystem
from airrace.vehicle import GRAVITY, Vehicle
from airrace.vehicle.free_body import motion_of, next_motion
from airrace.vehicle.rotors import RotorDynamics, make_rotor_dynamics, next_speed
from airrace.vehicle.state import STATE_SIZE, State, as_state, state_vector

_LEAST = 0.004  # s; shorter delays are ignored
_MOST = 0.25  # s; the model is not good enough for longer ones
_FOLLOWS = 0.6  # of the least speed commanded in a while: a rotor below has stopped
_WHILE = 30  # commands


class RigidBodyModel(NamedTuple):
    """What the prediction knows of the drone."""

    mass: float  #: kg
    inertia: np.ndarray  #: principal moments in B (kg m^2), (3,)
    allocation: np.ndarray  #: from the rotors' thrusts to [f, Mx, My, Mz], (4, n)
    rotors: RotorDynamics  #: their RotorDynamics, for one period
    period: float  #: of a step (s)


class DelayCompensator(LeafSystem):
    """Predicts the motion of the drone over the delay of a link.

    .. pydrake_system::

        name: DelayCompensator
        input_ports:
        - state_estimate
        - rotor_speeds
        - rotor_speed_command
        output_ports:
        - state_estimate
        - rotor_speeds

    ``state_estimate`` is a vehicle.State (14), the others have one speed a rotor
    (rad/s). The command is the one that is being sent. The outputs are the inputs
    carried forward by the delay there and back: by the rotors' lag and the
    equations of motion of a rigid body, under the commands that have been sent
    and not yet reported upon. So a controller acts on the state that its
    command will meet (O. J. Smith, "Closer control of loops with dead time", 1957).
    A rotor that does not follow its commands is shown as measured.

    With ``to_present``, the state is carried forward from its own time to that of the Context.
    """

    def __init__(
        self, *, vehicle: Vehicle, rate: float, delay: float = 0.0, to_present: bool = False
    ):
        """Constructs the compensator.

        Args:
            vehicle: mass, inertia and rotors.
            rate: of the commands (Hz).
            delay: there and back, whole periods, until set_delay() says otherwise (s).
            to_present: for estimates that come seldom.
        """
        LeafSystem.__init__(self)
        self._to_present = to_present
        n = len(vehicle.rotors)
        self._period = 1.0 / rate
        self._model = RigidBodyModel(
            mass=float(vehicle.mass),
            inertia=np.array(vehicle.inertia, float),
            allocation=vehicle.allocation,
            rotors=make_rotor_dynamics(vehicle, self._period),
            period=self._period,
        )
        self._estimate = self.DeclareVectorInputPort("state_estimate", STATE_SIZE)
        self._speeds = self.DeclareVectorInputPort("rotor_speeds", n)
        self._command = self.DeclareVectorInputPort("rotor_speed_command", n)
        # Commands, newest first, and since when the newest is in force (s).
        self._depth = math.ceil(_MOST * rate) + 1
        self._history = self.DeclareDiscreteState(self._depth * n)
        self._since = self.DeclareDiscreteState(1)
        self._delay = self.DeclareDiscreteState([delay])
        self.DeclarePeriodicDiscreteUpdateEvent(self._period, 0.0, self._remember)
        inputs = {self._estimate.ticket(), self._speeds.ticket(), self.xd_ticket()}
        if to_present:
            inputs.add(self.time_ticket())
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

    def set_delay(self, context: Context, delay: float) -> None:
        """Sets the delay, there and back (s), from rounded()."""
        context.SetDiscreteState(self._delay, [delay])

    def rounded(self, delay: float, before: float) -> float:
        """Returns the delay to use (s): whole periods, another one only if it matters.

        It is at most 0.25 s, for which the model is good enough.

        Args: delay: measured (s). before: used so far (s).
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
        # The command on the port now was computed one period ago.
        discrete_state.get_mutable_value(self._since)[0] = context.get_time() - self._period

    def _predicted(self, context):
        """Returns the two outputs."""
        estimate, speeds = self._estimate.Eval(context), self._speeds.Eval(context)
        delay = context.get_discrete_state(self._delay).value()[0]
        if self._to_present:
            delay = min(max(context.get_time() - as_state(estimate).time, 0.0), _MOST)
        elif delay < _LEAST:
            delay = 0.0
        if delay == 0.0 or not all_finite(estimate):
            return estimate, speeds
        commands = context.get_discrete_state(self._history).value().reshape(-1, len(speeds))
        since = context.get_discrete_state(self._since).value()[0]
        return _predict(estimate, speeds, commands, since, delay, self._model)


@compiled
def _predict(estimate, speeds, commands, since, delay, model):
    """Returns estimate, (14,), and speeds (rad/s), (n,), carried forward by a delay (s).

    Args:
        commands: newest first, (depth, n).
        since: when the newest was made (s).
        model: a RigidBodyModel.
    """
    state, h = as_state(estimate), model.period
    c_f = model.rotors.thrust_coefficients
    motion = motion_of(state)
    turning = speeds.copy()
    flying = np.sum(c_f * speeds * speeds) > FLYING * model.mass * GRAVITY
    # The command in force at the time of the estimate, and those after it.
    first = int(math.floor((since - state.time) / h)) + 1
    first = min(max(first, 0), len(commands) - 1)
    steps = int(round(delay / h))
    for k in range(steps):
        command, rotors = commands[max(first - k, 0)], model.rotors
        for i in range(len(turning)):
            limit, share = rotors.max_speeds[i], rotors.step_share
            turning[i] = next_speed(turning[i], command[i], limit, share)
        if flying:
            thrust, x, y, z = apply(model.allocation, c_f * turning * turning)
            specific_force = (0.0, 0.0, thrust / model.mass)
            motion = next_motion(motion, specific_force, (x, y, z), model.inertia, h)
    q, p, w, v = motion
    if flying:  # and the part of a period that is left
        rest = delay - steps * h
        q, p = integrate(q, w, rest), added(p, rest, v)
    after = speeds.copy()
    for i in range(len(speeds)):
        if not speeds[i] < _FOLLOWS * np.min(commands[first : first + _WHILE, i]):
            after[i] = turning[i]
    return state_vector(State(state.time + delay, q, p, w, v)), after
