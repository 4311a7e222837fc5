"""What code of one's own hands over, checked before anything computes with it.

Numpy broadcasts, Drake copies and machine code reads past an end: what has another shape, or is not
finite, would fly on and look like a bad controller. Here it is one sentence that says who gave
what, and what is wanted.
"""

import contextlib
import dataclasses as dc
import inspect
import math
import numbers
import typing
from collections.abc import Callable
from typing import Any

import numpy as np
from pydrake.math import RigidTransform

from airrace.common.errors import UserError

# Shapes of arrays, by the names of their fields; of fields that are not here, any is right.
_SHAPES = {
    "corners": (4, 2),
    "covariance": (6, 6),
    "p_WM": (3,),
    "p_WG": (3,),
    "variance": (3,),
    "normal": (3,),
}
_LONGEST = 200  # characters of what is quoted


def name_of(thing: Any) -> str:
    """Returns the full name of a function, or of the class of an object."""
    named = thing if hasattr(thing, "__qualname__") else type(thing)
    return f"{named.__module__}.{named.__qualname__}"


def refuse(who: str, value: Any, wanted: str) -> typing.NoReturn:
    """Raises the UserError on a value that is not what is wanted.

    Args: who: gave it, such as "my_team.MyController.calc_wrench()". wanted: in words.
    """
    text = " ".join(repr(value).split())
    text = text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
    kind = type(value).__name__
    if isinstance(value, np.ndarray):
        kind = f"{kind} of shape {value.shape}"
    raise UserError(f"{who} gave {text} ({kind}); it must give {wanted}.")


def check_arguments(function: Callable, *names: str) -> None:
    """Checks that a function can be called with some arguments, in this order.

    Args: names: what they are, for the sentence.

    Raises:
        UserError: if it takes others.
    """
    try:
        taken = inspect.signature(function)
    except (TypeError, ValueError):  # it is no function, or one of a language that tells nothing
        if callable(function):
            return
        refuse("A system of the scenario's own", function, f"a function of ({', '.join(names)})")
    try:
        taken.bind(*names)
    except TypeError:
        raise UserError(
            f"{name_of(function)}() is called with ({', '.join(names)}), but it takes {taken}: "
            "give it these arguments."
        ) from None


def finite_vector(who: str, value: Any, size: int, wanted: str) -> np.ndarray:
    """Returns a value as an array (size,) of finite float64.

    Args: see refuse().

    Raises:
        UserError: if it is anything else.
    """
    return _finite_array(who, value, (size,), wanted)


def _finite_array(who, value, shape, wanted):
    result = np.empty(0)
    if not isinstance(value, (str, bytes)):  # numpy would read a number in it
        with contextlib.suppress(TypeError, ValueError, OverflowError):
            result = np.asarray(value, float)
    if result.shape != shape or not np.isfinite(result).all():
        refuse(who, value, wanted)
    return result


def finite_number(who: str, value: Any) -> float:
    """Returns a value as a finite float; see finite_vector()."""
    return float(_finite_array(who, value, (), "a finite number"))


def check_value(who: str, value: Any, kind: type) -> None:
    """Checks that a value is of a dataclass, and all that it holds is as its fields say.

    Args: who: gave it, see refuse().

    Raises:
        UserError: naming the first field that is not.
    """
    if not isinstance(value, kind):
        refuse(who, value, f"an instance of {name_of(kind)}")
    if dc.is_dataclass(kind):
        hints = typing.get_type_hints(type(value))
        for field in dc.fields(value):  # type: ignore[arg-type]
            name, part = field.name, getattr(value, field.name)
            if wanted := _misfit(name, hints[name], part):
                refuse(f"{who}, {type(value).__name__}.{name},", part, wanted)
            _check_parts(f"{who}, {type(value).__name__}.{name},", hints[name], part)


def _check_parts(who, hint, value):
    """Checks dataclasses in a tuple, or in a field."""
    if typing.get_origin(hint) is tuple:
        element = typing.get_args(hint)[0]
        for part in value:
            if wanted := _misfit("", element, part):
                refuse(who, part, f"{wanted} in its tuple")
            _check_parts(who, element, part)
    elif dc.is_dataclass(hint):
        check_value(who, value, hint)


def _misfit(name, hint, value):
    """Returns what a field wants, if its value is not that."""
    args = typing.get_args(hint)
    if type(None) in args:
        return None if value is None else _misfit(name, args[0], value)
    if hint is float:
        is_number = isinstance(value, numbers.Real) and not isinstance(value, bool)
        return None if is_number and math.isfinite(value) else "a finite number"
    if hint is int:
        is_whole = isinstance(value, numbers.Integral) and not isinstance(value, bool)
        return None if is_whole else "a whole number"
    if hint is np.ndarray:
        shape = _SHAPES.get(name)
        fits = isinstance(value, np.ndarray) and value.dtype.kind in "fiu"
        if fits and (shape is None or value.shape == shape) and np.isfinite(value).all():
            return None
        return f"an array of finite numbers{f' of shape {shape}' if shape else ''}"
    kind = typing.get_origin(hint) or hint
    if not isinstance(kind, type) or isinstance(value, kind):
        is_pose = isinstance(value, RigidTransform)
        return "a finite pose" if is_pose and not _is_finite(value) else None
    return f"a {kind.__name__}"


def _is_finite(X: RigidTransform) -> bool:
    return bool(np.isfinite(X.GetAsMatrix34()).all())
