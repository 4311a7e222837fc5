"""What Python code hands over, as the plain types of a config's fields.

Numbers of numpy, whole numbers that are floats, and paths are as good as what YAML would give;
all else is refused in one sentence.
"""

import dataclasses as dc
import math
import numbers
import os
import reprlib
import typing
from typing import Any

import numpy as np

from airrace.common.errors import UserError

WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "text in quotes"}


def whole_number(name: str, value: Any, low: int, high: float = math.inf) -> int:
    """Returns a value as an int of a range.

    Raises:
        UserError: naming it and the range, if it is none.
    """
    result = _converted(int, value)
    if result is None or not low <= result <= high:
        range_ = f"from {low} to {high}" if high < math.inf else f"from {low} on"
        raise UserError(f"{name} must be a whole number {range_}, not {reprlib.repr(value)}.")
    return result


def plain(name: str, schema: Any, value: Any) -> Any:
    """Returns a value as the type of a field that takes plain types; others come back as they are.

    Lists, dicts and dataclasses are gone through, and dataclasses are changed in place.

    Args:
        name: to call it, such as ``camera.fps``. schema: the type, such as ``float | None``.

    Raises:
        UserError: naming the field, what it takes, and what came.
    """
    args = typing.get_args(schema)
    if type(None) in args:  # Optional
        return None if value is None else plain(name, args[0], value)
    if schema in WORDS:
        result = _converted(schema, value)
        if result is None:
            raise UserError(f"{name} must be {WORDS[schema]}, not {reprlib.repr(value)}.")
        return result
    origin = typing.get_origin(schema)
    if origin is list and isinstance(value, (list, tuple, np.ndarray)):
        return [plain(f"{name}[{i}]", args[0], each) for i, each in enumerate(value)]
    if origin is dict and isinstance(value, dict):
        return {key: plain(f"{name}.{key}", args[1], each) for key, each in value.items()}
    if dc.is_dataclass(schema) and isinstance(value, schema):  # type: ignore[arg-type]
        make_plain(value, f"{name}.")
        return value
    if origin is list or origin is dict or not isinstance(value, origin or schema):
        kind = getattr(origin or schema, "__name__", str(schema))
        raise UserError(f"{name} must be a {kind}, not {reprlib.repr(value)}.")
    return value


def make_plain(config: Any, prefix: str = "") -> None:
    """Gives all fields of a dataclass their plain types; see plain().

    Args: prefix: of the names of the fields, in the sentence of an error.
    """
    types = typing.get_type_hints(type(config))
    for field in dc.fields(config):
        value = getattr(config, field.name)
        setattr(config, field.name, plain(prefix + field.name, types[field.name], value))


def plain_tree(name: str, value: Any) -> Any:
    """Returns dicts and lists of plain values, as JSON and YAML have them.

    Args: name: of the whole, in the sentence of an error.

    Raises:
        UserError: naming what has no place there.
    """
    if isinstance(value, dict):
        return {key: plain_tree(f"{name}[{key!r}]", each) for key, each in value.items()}
    if isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.ndim):
        return [plain_tree(f"{name}[{i}]", each) for i, each in enumerate(value)]
    if value is None or type(value) in WORDS:
        return value
    for schema in (str, bool, int, float):
        if (result := _converted(schema, value)) is not None:
            return result
    raise UserError(f"{name} must be a number, text, a list or a dict, not {reprlib.repr(value)}.")


def _converted(schema, value):
    """Returns a value as an instance of bool, int, float or str; None if it is none."""
    if isinstance(value, np.generic) or (isinstance(value, np.ndarray) and not value.ndim):
        value = value.item()
    if schema is str:
        path = os.fspath(value) if isinstance(value, (str, os.PathLike)) else None
        return path if isinstance(path, str) else None
    if schema is bool or isinstance(value, bool):
        return value if type(value) is schema else None
    if not isinstance(value, numbers.Real):
        return None
    try:
        if schema is int:
            return int(value) if math.isfinite(value) and value == int(value) else None
        return value if type(value) is float else float(value)
    except OverflowError:  # a whole number beyond all floats
        return None
