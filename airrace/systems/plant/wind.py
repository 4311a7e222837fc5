"""The wind over the track."""

import functools
import math

import numpy as np

from airrace.math.random import NoiseSequence, make_generator
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.seed import declare_seed
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
        input_ports:
        - seed (may be left open)
        output_ports:
        - wind

    ``wind`` (3) is the velocity of the air in the world (m/s). Each component
    of the gusts is an Ornstein-Uhlenbeck process (Uhlenbeck and Ornstein, "On
    the theory of the Brownian motion", 1930), advanced exactly over a period
    (Gillespie, "Exact numerical simulation of the Ornstein-Uhlenbeck process
    and its integral", 1996). Its spectrum is that of Dryden's longitudinal
    gusts (MIL-F-8785C, section 3.7) where the length of turbulence over the
    airspeed, L / V, is ``gust_time``. ``seed``: see SeedSource.
    """

    def __init__(self, *, config: WindConfig, seed: int):
        """Args: config: the wind. seed: of all that is random, until the port says another one."""
        LeafSystem.__init__(self)
        self._config = config
        self._fade, self._push = gust_factors(config)
        self._noise = NoiseSequence.of_seeds("wind", 3)
        self._seed = declare_seed(self, seed)
        self._wind = self.DeclareDiscreteState(self._first(seed))
        self._started = self.DeclareDiscreteState(1)  # 0: with the wind of another seed, perhaps
        self.DeclareInitializationDiscreteUpdateEvent(self._start)
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, PERIOD, self._update_wind)
        self.DeclareStateOutputPort("wind", self._wind)

    def _mean(self, seed: int) -> np.ndarray:
        """Returns the steady wind (m/s), (3,), whose direction may be drawn."""
        return np.array(self._config.mean) + self._config.mean_speed * _direction(seed)

    def _first(self, seed: int) -> np.ndarray:
        """Returns the wind at the start (m/s), (3,); the first gust is as strong as any other."""
        return self._mean(seed) + self._config.gust_rms * self._noise(seed)[0]

    def _start(self, context, discrete_state):
        started = context.get_discrete_state(self._started).value()[0]
        if not started or context.get_time() == 0.0:
            discrete_state.set_value(self._wind, self._first(self._seed(context)))
            discrete_state.set_value(self._started, [1.0])

    def _update_wind(self, context, discrete_state):
        seed = self._seed(context)
        noise = self._noise(seed)[round(context.get_time() / PERIOD)]
        wind = context.get_discrete_state(self._wind).value()
        rest = (1.0 - self._fade) * self._mean(seed)
        discrete_state.set_value(self._wind, rest + self._fade * wind + self._push * noise)


@functools.lru_cache(maxsize=8)
def _direction(seed: int) -> np.ndarray:
    """Returns where the drawn part of the wind goes to, a level unit vector in the world, (3,)."""
    angle = make_generator(seed, "wind_direction").uniform(0.0, 2.0 * math.pi)
    return np.array([math.cos(angle), math.sin(angle), 0.0])
