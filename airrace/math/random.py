"""Named random generators, all from the scenario's one seed.

From what a generator with a short seed has drawn, all seeds can be tried until one fits; then the
others that it has made are known as well. So a seed that must not be guessed is longer, and its
generators are derived one by one, so that none of them tells anything of another.
"""

import functools
import hashlib
import hmac
import zlib
from collections.abc import Callable

import numpy as np

_BLOCK = 4096
SHORT = 2**53  # the greatest seed that a number of Drake's can hold
_long: dict[int, int] = {}  # seeds by their short names


def make_generator(seed: int, name: str, block: int = 0) -> np.random.Generator:
    """Returns the generator of one named source of randomness.

    Sources with different names are independent, so that a new source never
    changes the numbers of the others.

    Args: seed: the scenario's, >= 0, or its short name. block: of a longer sequence, see
    NoiseSequence.
    """
    seed = _long.get(seed, seed)
    if seed > SHORT:
        return np.random.default_rng(derive(f"{seed}", f"{name} {block}"))
    return np.random.default_rng([seed, zlib.crc32(name.encode()), block])


def derive(secret: str, label: str) -> int:
    """Returns a seed of 256 bits, which tells nothing of the secret or of those of other labels.

    By HMAC (RFC 2104) with SHA-256. secret: that nobody can guess.
    """
    return int.from_bytes(hmac.digest(secret.encode(), label.encode(), hashlib.sha256), "big")


def short_name(seed: int) -> int:
    """Returns what stands for a seed where there is room for a short one: itself, if it is short.

    make_generator() knows the long one by it, in this process.
    """
    if seed <= SHORT:
        return seed
    name = derive(f"{seed}", "short name") % SHORT
    _long[name] = seed
    return name


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
