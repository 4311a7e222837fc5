"""Named random generators, all from the scenario's one seed."""

import functools
import zlib
from collections.abc import Callable

import numpy as np

_BLOCK = 4096


def make_generator(seed: int, name: str, block: int = 0) -> np.random.Generator:
    """Returns the generator of one named source of randomness.

    Sources with different names are independent, so that a new source never
    changes the numbers of the others.

    Args: seed: the scenario's, >= 0. block: of a longer sequence, see NoiseSequence.
    """
    return np.random.default_rng([seed, zlib.crc32(name.encode()), block])


class NoiseSequence:
    """Standard normal vectors addressed by index: a pure function of it.

    A system that keeps a Generator would hide mutable state from its
    Context; one that takes its noise by the tick count does not.
    """

    def __init__(self, seed: int, name: str, size: int):
        """Args: seed, name: see make_generator. size: of each vector."""

        @functools.lru_cache(maxsize=2)
        def draw(block):
            return make_generator(seed, name, block).standard_normal((_BLOCK, size))

        self._draw = draw

    @staticmethod
    def of_seeds(name: str, size: int) -> Callable[[int], "NoiseSequence"]:
        """Returns a function of a seed, which remembers the sequences of the newest seeds."""
        return functools.lru_cache(maxsize=4)(lambda seed: NoiseSequence(seed, name, size))

    def __getitem__(self, index: int) -> np.ndarray:
        """Returns vector number ``index`` >= 0, shape (size,)."""
        return self._draw(index // _BLOCK)[index % _BLOCK]
