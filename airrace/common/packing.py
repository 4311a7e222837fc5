"""Vectors whose parts have names: NamedTuples of numbers and arrays, one after the other.

Ports and discrete states are vectors, and what is in them has parts. A Packing says where each
part is, once; nobody else counts indices.
"""

import zlib
from collections.abc import Callable
from typing import Any

import numpy as np

from airrace.common.jit import compilable

type _Shape = int | tuple[int, ...] | None


class Packing[Parts]:
    """How the fields of a NamedTuple are laid out in a vector: in their order, without gaps.

    Compiled functions find its own under names of their module:

        _PACKING = Packing(Ball, centre=3)
        as_ball, ball_vector, BALL_SIZE = _PACKING.parts, _PACKING.vector, _PACKING.size

    Attributes:
        size: of the vector, but for a field of any length.
        at: the NamedTuple of where the fields are: the index of a number, the slice of an array.
        parts: a function of a vector, (size,), to the NamedTuple of its parts; arrays are views of
            it. If N vectors are columns, (size, N), so are the parts, (N,) or (n, N).
        vector: the inverse, which copies. A number in the place of a vector fills it.
    """

    size: int
    at: Any
    parts: Callable[[np.ndarray], Parts]
    vector: Callable[[Parts], np.ndarray]

    def __init__(self, parts: type[Parts], **shapes: _Shape):
        """Constructs the packing.

        Args:
            parts: the NamedTuple.
            shapes: of its arrays by name; its other fields are numbers. One may be of any length:
                -1, or a tuple that begins with -1, takes what the others leave. A field of shape
                None is not in the vector; it is NaN.

        Raises:
            ValueError: if one of the names is not a field.
        """
        names: tuple[str, ...] = parts._fields  # type: ignore[attr-defined]
        if not shapes.keys() <= set(names):
            raise ValueError(f"{parts.__name__} has not all the fields {sorted(shapes)}")
        every = [shapes.get(name, ()) for name in names]
        sizes = [0 if shape is None else int(np.prod(shape)) for shape in every]
        self.size = sum(size for size in sizes if size > 0)
        where = [s if shape != () else s.start for shape, s in zip(every, _slices(sizes))]
        self.at = parts(*where)
        self.parts = _parts_function(parts, where, every)
        self.vector = _vector_function(parts, where, every, self.size)


def _slices(sizes: list[int]) -> list[slice]:
    """Returns where parts of some sizes are; behind one of any length, below zero, from the end."""
    rest = next((i for i, size in enumerate(sizes) if size < 0), len(sizes))
    return [
        slice(
            sum(sizes[:i]) if i <= rest else -sum(sizes[i:]),
            sum(sizes[: i + 1]) if i < rest else -sum(sizes[i + 1 :]) or None,
        )
        for i in range(len(sizes))
    ]


# Numba sees no loop over fields of several types. So the functions are written here, as those of a
# dataclass are: each as somebody would by hand.


def _parts_function(parts, where, shapes):
    """Returns Packing.parts, such as: return Ball(vector[0], vector[1:4])."""
    views = [
        "np.nan" if shape is None else f"vector[{_text(at)}]{_call('reshape', shape, shape)}"
        for at, shape in zip(where, shapes)
    ]
    return _defined(parts, f"as_{parts.__name__}(vector): return Parts({', '.join(views)})")


def _vector_function(parts, where, shapes, size):
    """Returns Packing.vector."""
    fields = [each for each in zip(parts._fields, where, shapes) if each[2] is not None]
    rest = [f" + parts.{name}.size" for name, _, shape in fields if np.prod(shape) < 0]
    lines = [
        f"result[{_text(at)}] = parts.{name}{_call('ravel', shape)}" for name, at, shape in fields
    ]
    body = [f"result = np.empty({size}{''.join(rest)})", *lines, "return result"]
    return _defined(parts, f"{parts.__name__}_vector(parts):\n  " + "\n  ".join(body))


def _call(method, shape, argument=""):
    """Returns the text of a call, for what is a tuple with numbers."""
    return f".{method}({argument})" if isinstance(shape, tuple) and shape else ""


def _text(where: int | slice) -> str:
    return f"{where.start}:{where.stop or ''}" if isinstance(where, slice) else str(where)


def _defined(parts, source):
    """Returns the function of a text that follows "def"; where it stands, Parts is the class."""
    names = {"__name__": parts.__module__, "Parts": parts, "np": np}
    exec(f"def {source}", names)
    function = names[source.split("(")[0]]
    # Numba keeps machine code by this name: it must be no other function's.
    function.__qualname__ = f"{function.__name__}_{zlib.crc32(source.encode()):x}"
    return compilable(function)
