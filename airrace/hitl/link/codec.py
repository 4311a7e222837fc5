"""Values as LCM messages whose fields have the same names, and back."""

import types
import typing
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from airrace.common.immutable import read_only
from airrace.common.words import printable
from airrace.hitl.link.packets import MALFORMED, NOT_FINITE, Dropped


class Codec(typing.NamedTuple):
    """How values of a kind cross the link.

    Decoding an encoded value gives the same value, to the last bit. A message whose
    numbers cannot be such a value raises Dropped.
    """

    message_type: type[Any]  # of airrace.lcmtypes
    encode: Callable  # from a value to a message
    decode: Callable  # from a message to a value

    def of(self, before: Callable, after: Callable) -> "Codec":
        """Returns the Codec of what before() makes these values of, and after() makes of them."""
        return Codec(
            self.message_type,
            lambda value: self.encode(before(value)),
            lambda message: after(self.decode(message)),
        )


def check_finite(*values: Any) -> None:
    """Raises Dropped unless all numbers, and those in sequences, are finite."""
    if not all(np.isfinite(value).all() for value in values):
        raise Dropped(NOT_FINITE)


def field_codec(
    value_type: type,
    message_type: type[Any],
    parts: dict[str, Codec] | None = None,
    infinite: Iterable[str] = (),
) -> Codec:
    """Returns the Codec of a dataclass or NamedTuple, field by field.

    Fields have the same names in the message. By their annotations, an array or a tuple is
    an array, a RigidTransform is [R, p], what may be None is an array of at most one
    element, and a dict is two arrays whose names begin with its own. What counts the
    elements of an array follows from it.

    Args:
        parts: name of a field that is another such value, or a tuple of them, to their Codec.
        infinite: names of the arrays that may have infinite elements.
    """
    parts = parts or {}
    kinds = {
        name: None if isinstance(kind, types.UnionType) else typing.get_origin(kind) or kind
        for name, kind in typing.get_type_hints(value_type).items()
    }
    pairs = {
        name: [slot for slot in message_type.__slots__ if slot.startswith(f"{name}_")]
        for name, kind in kinds.items()
        if kind is dict
    }
    counts = {
        dimensions[0]: name
        for name, dimensions in zip(message_type.__slots__, message_type.__dimensions__)
        if dimensions and isinstance(dimensions[0], str)
    }

    def encode(value):
        message = message_type()
        for name, kind in kinds.items():
            each = getattr(value, name)
            if name in parts:
                encoded = parts[name].encode
                setattr(message, name, [*map(encoded, each)] if kind is tuple else encoded(each))
            elif kind is dict:
                for slot, numbers in zip(pairs[name], (each.keys(), each.values())):
                    setattr(message, slot, list(numbers))
            else:
                setattr(message, name, _encoded(kind, each))
        for count, name in counts.items():
            setattr(message, count, len(getattr(message, name)))
        return message

    def decode(message):
        values = {}
        for name, kind in kinds.items():
            if kind is dict:
                keys, items = (_decoded(tuple, getattr(message, slot)) for slot in pairs[name])
                values[name] = dict(zip(keys, items))
                continue
            each = getattr(message, name)
            if name in parts:
                decoded = parts[name].decode
                values[name] = tuple(map(decoded, each)) if kind is tuple else decoded(each)
            else:
                values[name] = _decoded(kind, each, name in infinite)
        return value_type(**values)

    return Codec(message_type, encode, decode)


def _encoded(kind, value):
    if kind is np.ndarray:
        return np.asarray(value).tolist()
    if kind is RigidTransform:
        return value.GetAsMatrix34().tolist()
    if kind is tuple:
        return list(value)
    if kind is None:
        return [] if value is None else [value]
    return value.item() if isinstance(value, np.generic) else value


def _decoded(kind, value, may_be_infinite=False):
    if kind is np.ndarray:
        array = read_only(value)
        if np.isnan(array).any() or not (may_be_infinite or np.isfinite(array).all()):
            raise Dropped(NOT_FINITE)
        return array
    if kind is RigidTransform:
        matrix = np.array(value)
        check_finite(matrix)
        try:
            return RigidTransform(RotationMatrix(matrix[:, :3]), matrix[:, 3])
        except (RuntimeError, ValueError):  # not a rotation
            raise Dropped(MALFORMED) from None
    if kind is None:
        if len(value) > 1:
            raise Dropped(MALFORMED)
        return _decoded(type(value[0]), value[0]) if value else None
    if kind is tuple:
        check_finite([each for each in value if isinstance(each, float)])
    if kind is float:
        check_finite(value)
    if kind is str:
        return printable(value)
    return kind(value)
