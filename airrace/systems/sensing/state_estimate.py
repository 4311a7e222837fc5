"""The state estimate of the simulated autopilot, the only one that the autonomy gets."""

import math

from airrace.common.jit import assign, compiled
from airrace.math.random import NoiseSequence
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_vector
from airrace.systems.seed import declare_seed
from airrace.systems.sensing.pose_history import moved
from airrace.vehicle.state import STATE_SIZE, as_state

_MOMENT = 1e-9  # s, that only rounding makes


class StateEstimate(LeafSystem):
    """Samples the true state and adds the original system's noise.

    .. pydrake_system::

        name: StateEstimate
        input_ports:
        - state
        - seed (may be left open)
        output_ports:
        - state_estimate

    ``state`` is the plant's floating-base state (13). ``state_estimate`` (14) is a
    vehicle.State: the time of the sample (s) and the same, with white noise on the
    position and a random factor on each horizontal velocity component. ``seed``: see SeedSource.

    Between its steps a discrete plant shows the state at the end of the step; the pose
    goes back from there to the time of the sample.
    """

    def __init__(
        self,
        *,
        rate: float,
        position_sigma: float = 0.0,
        velocity_sigma: float = 0.0,
        seed: int = 0,
        state_period: float = 0.0,
    ):
        """Constructs the estimate.

        Args:
            rate: samples per second (Hz).
            position_sigma: of the noise on each position coordinate (m).
            velocity_sigma: of the factor 1 + N(0, sigma) on v_x and v_y.
            seed: of the noise, if the port is left open.
            state_period: of the plant's steps (s); 0 if its state is continuous.
        """
        LeafSystem.__init__(self)
        self._rate = rate
        self._sigmas = position_sigma, velocity_sigma
        self._noise = NoiseSequence.of_seeds("state_estimate", 5)
        self._seed = declare_seed(self, seed)
        self._state_period = state_period
        self._state = self.DeclareVectorInputPort("state", STATE_SIZE - 1)
        index = self.DeclareDiscreteState(STATE_SIZE)
        self.DeclareStateOutputPort("state_estimate", index)
        # The controller's first tick must already see a sample.
        self.DeclareInitializationDiscreteUpdateEvent(self._start)
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / rate, 0.0, self._sample)

    def _start(self, context, discrete_state):
        # A flight that goes on has a sample, and gets the next one when it is due.
        is_new = not as_state(context.get_discrete_state_vector().value()).quaternion.any()
        if is_new or context.get_time() == 0.0:
            self._sample(context, discrete_state)

    def _sample(self, context, discrete_state):
        time = context.get_time()
        _sample(
            discrete_state.get_mutable_value(),
            read_vector(self._state, context),
            time,
            plant_lead(time, self._state_period),
            self._noise(self._seed(context))[round(time * self._rate)],
            self._sigmas,
        )


@compiled
def _sample(sample, plant_state, time, lead, noise, sigmas):
    """Fills a sample, (14,).

    Args:
        plant_state: (13,), and by how much it is ahead of that time: lead (s).
        time: of the sample (s).
        noise: standard normal numbers, (5,), of position, v_x and v_y.
        sigmas: of position and velocity, see StateEstimate.
    """
    position_sigma, velocity_sigma = sigmas
    sample[0] = time
    assign(sample[1:], plant_state)
    _, quaternion, position, _, velocity = as_state(sample)
    if lead > _MOMENT:
        before = moved(sample, -lead)
        assign(quaternion, before[0])
        assign(position, before[1])
    position += position_sigma * noise[:3]
    velocity[:2] *= 1.0 + velocity_sigma * noise[3:]


def plant_lead(time: float, period: float) -> float:
    """Returns by how much the state that a discrete plant shows at a time is ahead of it (s).

    Between its steps a plant shows the state at the end of the step; at the time of a step,
    before it is made, the one of that time.

    Args:
        time: at which the state is read (s).
        period: of the plant's steps (s); 0 if its state is continuous.
    """
    return math.ceil(time / period - 1e-6) * period - time if period > 0.0 else 0.0


class TrueEstimate(LeafSystem):
    """Shows the truth as an estimate, to environments and flight controllers, but no autonomy.

    .. pydrake_system::

        name: TrueEstimate
        input_ports:
        - truth.state
        output_ports:
        - filtered_estimate

    ``truth.state`` is the plant's floating-base state (13), ``filtered_estimate`` a
    vehicle.State (14).
    """

    def __init__(self) -> None:
        """Constructs the system."""
        LeafSystem.__init__(self)
        self._state = self.DeclareVectorInputPort("truth.state", STATE_SIZE - 1)
        self.DeclareVectorOutputPort("filtered_estimate", STATE_SIZE, self._calc_estimate)

    def _calc_estimate(self, context, output):
        estimate = output.get_mutable_value()
        estimate[0] = context.get_time()
        estimate[1:] = read_vector(self._state, context)
