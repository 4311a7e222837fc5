"""The wind over the track."""

import math

import numpy as np

from airrace.math.random import NoiseSequence, make_generator
from airrace.systems.leaf_system import LeafSystem
from airrace.vehicle.disturbances import WindConfig

PERIOD = 0.01  # s, between two values


def gust_factors(config: WindConfig) -> tuple[float, float]:
    """Returns what is left of a gust after PERIOD, and the noise that is added then (m/s)."""
    fade = math.exp(-PERIOD / config.gust_time)
    return fade, config.gust_rms * math.sqrt(1.0 - fade * fade)


class Wind(LeafSystem):
    """A steady wind and its gusts, the same everywhere.

    .. pydrake_system::

        name: Wind
        output_ports:
        - wind

    ``wind`` (3) is the velocity of the air in the world (m/s). Each component
    of the gusts is an Ornstein-Uhlenbeck process (Uhlenbeck and Ornstein, "On
    the theory of the Brownian motion", 1930), advanced exactly over a period
    (Gillespie, "Exact numerical simulation of the Ornstein-Uhlenbeck process
    and its integral", 1996). Its spectrum is that of Dryden's longitudinal
    gusts (MIL-F-8785C, section 3.7) where the length of turbulence over the
    airspeed, L / V, is ``gust_time``.
    """

    def __init__(self, *, config: WindConfig, seed: int):
        """Args: config: the wind. seed: of the gusts and of where ``mean_speed`` comes from."""
        LeafSystem.__init__(self)
        self._fade, self._push = gust_factors(config)
        angle = make_generator(seed, "wind_direction").uniform(0.0, 2.0 * math.pi)
        drawn = config.mean_speed * np.array([math.cos(angle), math.sin(angle), 0.0])
        mean = np.array(config.mean) + drawn
        self._rest = (1.0 - self._fade) * mean
        self._noise = NoiseSequence(seed, "wind", 3)
        # The first gust is as strong as any other.
        state = self.DeclareDiscreteState(mean + config.gust_rms * self._noise[0])
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, PERIOD, self._update_wind)
        self.DeclareStateOutputPort("wind", state)

    def _update_wind(self, context, discrete_state):
        noise = self._noise[round(context.get_time() / PERIOD)]
        wind = context.get_discrete_state_vector().value()
        discrete_state.set_value(self._rest + self._fade * wind + self._push * noise)
