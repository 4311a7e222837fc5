"""Reads JSON that others may have written or edited, and checks it against a schema.

A schema is a TypedDict, or what such a one is made of: ``int``, ``float``, ``str``, ``bool``,
``None``, ``object`` (any JSON), ``list[T]``, ``dict[str, T]``, ``A | B``, ``Literal[...]`` and
``NotRequired[T]``. Keys beyond those of a TypedDict are left as they are, so that old programs
read newer files.
"""

import functools
import json
import types
import typing
from pathlib import Path
from typing import Any, Literal, NotRequired, Union

from airrace.common.errors import UserError, words
from airrace.common.files import read_regular

_MAX_BYTES = 64_000_000
_MAX_DEPTH = 60  # lists and objects within one another
_MAX_NUMBER = 1e15  # so that no reader's arithmetic overflows
_MAX_WHOLE = 1 << 512  # seeds are long
_WORDS: dict[object, str] = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "a text",
    None: "null",
    types.NoneType: "null",
}


def read_json[T](path: Path, schema: type[T], what: str, remedy: str) -> T:
    """Returns what a file of JSON holds.

    Args:
        path: the file.
        schema: see above.
        what: what the file should be, such as "race.json".
        remedy: what to do if it is none, such as "name the folder that a race left".

    Raises:
        UserError: if it cannot be read, or does not fit the schema; with the first misfit's place.
    """
    try:
        data = read_regular(path, _MAX_BYTES + 1)
        if len(data) > _MAX_BYTES:
            raise ValueError(f"it is larger than {_MAX_BYTES // 1_000_000} MB")
        return parse_json(data, schema)
    except OSError as e:
        raise UserError(f"{path} cannot be read ({words(e)}); {remedy}.") from None
    except ValueError as e:
        raise UserError(f"{path} is no {what}: {e}; {remedy}.") from None


def parse_json[T](data: str | bytes, schema: type[T]) -> T:
    """Returns what a text of JSON holds.

    Raises:
        ValueError: if it does not fit the schema; the message is a clause that says why.
    """
    try:
        text = data if isinstance(data, str) else data.decode("utf-8")
        value = json.loads(text, parse_constant=_refuse_constant, object_pairs_hook=_unique)
    except UnicodeDecodeError:
        raise ValueError("it is not a text in UTF-8") from None
    except json.JSONDecodeError as e:
        raise ValueError(f"it is not JSON ({e.msg}, line {e.lineno})") from None
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    _check_plain(value, 0)
    _check(value, schema, "")
    return value


def _refuse_constant(name: str) -> None:
    raise ValueError(f"JSON has no {name}")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Returns an object of JSON: whose keys come twice, readers take for different ones."""
    result = dict(pairs)
    if len(result) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"{json.dumps(twice)[:60]} is there twice in one object")
    return result


def _check_plain(value: Any, depth: int) -> None:
    """Raises ValueError if plain data has what no reader can use."""
    if depth > _MAX_DEPTH:
        raise ValueError("it is nested too deeply")
    match value:
        case str():
            if any("\ud800" <= c <= "\udfff" for c in value):
                raise ValueError("a text has half of a character")
        case bool() | None:
            pass
        case int() | float():
            if not abs(value) <= (_MAX_NUMBER if isinstance(value, float) else _MAX_WHOLE):
                raise ValueError("a number is too large")
        case list():
            for each in value:
                _check_plain(each, depth + 1)
        case dict():
            for key, each in value.items():
                _check_plain(key, depth + 1)
                _check_plain(each, depth + 1)


def _check(value: Any, schema: Any, name: str) -> None:
    """Raises ValueError if a value, which has a name, does not fit a schema."""
    origin, args = typing.get_origin(schema), typing.get_args(schema)
    if origin is NotRequired:
        _check(value, args[0], name)
    elif origin in (Union, types.UnionType):
        _check_choice(value, args, name)
    elif origin is Literal:
        if value not in args:
            raise _misfit(value, name, " or ".join(json.dumps(each) for each in args))
    elif schema is list or origin is list:
        if not isinstance(value, list):
            raise _misfit(value, name, "a list")
        for i, each in enumerate(value if args else ()):
            _check(each, args[0], f"{name}[{i}]")
    elif schema is dict or origin is dict or typing.is_typeddict(schema):
        if not isinstance(value, dict):
            raise _misfit(value, name, "an object")
        fields = _fields(schema) if origin is None else {}
        for key in getattr(schema, "__required_keys__", ()):
            if key not in value:
                raise ValueError(f"{_joined(name, key)} is missing")
        for key, each in value.items():
            if args or key in fields:
                _check(each, args[1] if args else fields[key], _joined(name, key))
    elif not _is_a(value, schema):
        raise _misfit(value, name, _WORDS[schema])


@functools.cache
def _fields(schema: Any) -> dict[str, Any]:
    """Returns the types of the fields of a TypedDict."""
    return typing.get_type_hints(schema, include_extras=True)


def _check_choice(value: Any, schemas: tuple, name: str) -> None:
    """Raises ValueError if a value fits none of some schemas, about the one that is no null."""
    if value is None and types.NoneType in schemas:
        return
    *others, last = [each for each in schemas if each is not types.NoneType]
    for schema in others:
        try:
            return _check(value, schema, name)
        except ValueError:
            continue
    _check(value, last, name)


def _is_a(value: Any, schema: Any) -> bool:
    """Whether a value is of a plain type; a number may be written as a whole one."""
    if schema is float:
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        return is_number and abs(value) <= _MAX_NUMBER
    if schema is object:
        return True
    return type(value) is (types.NoneType if schema is None else schema)


def _misfit(value: Any, name: str, expected: str) -> ValueError:
    shown = json.dumps(value)
    shown = shown if len(shown) <= 40 else f"{shown[:37]}..."
    return ValueError(f"{name or 'it'} is {shown}, expected {expected}")


def _joined(name: str, key: str) -> str:
    return f"{name}.{key}" if name else key
