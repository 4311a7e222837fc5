"""Finds the files under ``models/`` and loads YAML into dataclasses."""

import dataclasses as dc
import functools
import os
import reprlib
import typing
from pathlib import Path
from typing import Any

import yaml
from pydrake.common.yaml import yaml_load_typed

from airrace.common.errors import UserError
from airrace.common.plain_values import WORDS
from airrace.common.strict_yaml import plain_data, read_yaml

PACKAGE = Path(__file__).resolve().parents[1]  # the folder of airrace's code


@functools.cache
def models_path() -> Path:
    """Returns the folder of models, tracks and scenarios.

    It lies inside the package in an installed airrace and beside it in a
    checkout.
    """
    for candidate in (PACKAGE / "models", PACKAGE.parent / "models"):
        if (candidate / "package.xml").is_file():
            return candidate
    raise UserError(
        f"airrace's models folder is missing beside {PACKAGE}; clone or install airrace again."
    )


def find_yaml(kind: str, name_or_file: str | os.PathLike[str]) -> Path:
    """Returns the path of a shipped YAML file by name, or of any by path.

    Args:
        kind: the folder below ``models/``: ``"tracks"`` or ``"scenarios"``.
        name_or_file: a bare name such as ``student-airrace``, or a file.

    Raises:
        UserError: if there is neither.
    """
    name_or_file = os.fspath(name_or_file)
    folder = models_path() / kind
    # os.path: pathlib's is_file() raises on names that are too long.
    if "/" not in name_or_file and os.path.isfile(folder / f"{name_or_file}.yaml"):
        return folder / f"{name_or_file}.yaml"
    if os.path.isfile(name_or_file):
        return Path(name_or_file)
    names = ", ".join(sorted(p.stem for p in folder.glob("*.yaml")))
    raise UserError(
        f"There is no {kind.removesuffix('s')} named '{name_or_file}' and no "
        f"such file; the shipped {kind} are: {names}."
    )


def load_yaml[T](
    schema: type[T],
    *,
    filename: str | Path | None = None,
    data: str | None = None,
    what: str = "the text",
    **kwargs: Any,
) -> T:
    """Loads YAML with Drake's ``yaml_load_typed``; bad files raise UserError.

    Args:
        schema: the dataclass to load.
        filename: the file to read, or
        data: the text to read.
        what: to call that text.
        kwargs: passed on (``child_name``, ``defaults``).

    A dataclass may have a dict ``OLD_NAMES`` of what its fields were once called, so that whoever
    has an old file learns the new names.

    Raises:
        UserError: naming the file and what is wrong with it.
    """
    source = str(filename) if data is None else f"{what} '{' '.join(data.split())}'"
    text = read_yaml(source, filename=filename, data=data)
    try:
        return yaml_load_typed(schema=schema, data=text, **kwargs)
    except (yaml.YAMLError, RecursionError) as e:  # such as a tag of another language
        problem = getattr(e, "problem", None) or "it is nested too deeply"
        mark = getattr(e, "problem_mark", None)
        where = f" at line {mark.line + 1}" if mark else ""
        raise UserError(f"{source} is not valid YAML{where}: {problem}.") from None
    except Exception as e:  # Drake's loader raises bare RuntimeError, KeyError, ...
        document = plain_data(text)
        reason = _misfit(schema, document, kwargs.get("child_name")) or " ".join(str(e).split())
        raise UserError(f"{source} does not fit its schema: {reason.rstrip('.')}.") from None


def _misfit(schema, document, child_name):
    """Returns a clause on the first thing that Drake's loader refuses, or None.

    Drake's own messages leave out where that is, or what there is instead.
    """
    if child_name is not None:
        if not isinstance(document, dict) or child_name not in document:
            there = ", ".join(map(str, document)) if isinstance(document, dict) else "no keys"
            return f"it has no '{child_name}' at its top level, only: {there}"
        document = document[child_name]
    elif isinstance(document, dict):  # the loader skips keys such as _defaults
        document = {k: v for k, v in document.items() if not str(k).startswith("_")}
    return _value_misfit("", schema, document)


def _item_name(name: str, schema: object, number: int) -> str:
    """Returns what to call an item of a list, counted as people do: "gate 2" of "gates"."""
    of_words = schema in WORDS
    return f"{name}, number {number}," if of_words else f"{name.removesuffix('s')} {number}"


def _value_misfit(name, schema, value):
    if schema in WORDS:
        fits = _fits(schema, value)
        return None if fits else f"{name} must be {WORDS[schema]}, not {reprlib.repr(value)}"
    args = typing.get_args(schema)
    if type(None) in args:  # Optional
        return None if value is None else _value_misfit(name, args[0], value)
    if len(args) == 1:  # a list
        if not isinstance(value, list):
            return f"{name} must be a list in brackets [ ], not {reprlib.repr(value)}"
        items = ((_item_name(name, args[0], k), args[0], item) for k, item in enumerate(value, 1))
    elif not isinstance(value, dict):
        return f"{name or 'it'} must be a mapping from names to values, not {reprlib.repr(value)}"
    elif args:  # a dictionary
        items = ((f"{name}.{key}", args[1], item) for key, item in value.items())
    else:
        prefix = f"{name}." if name and not name[-1].isdigit() else f"{name}: " if name else ""
        types = _field_types(schema)
        unknown = [key for key in value if key not in types]
        if unknown:
            old = getattr(schema, "OLD_NAMES", {}).get(unknown[0])
            hint = f"its name is {prefix}{old} now" if old else f"there are: {', '.join(types)}"
            return f"{prefix}{unknown[0]} is unknown; {hint}"
        items = ((f"{prefix}{key}", types[key], item) for key, item in value.items())
    return next(filter(None, (_value_misfit(*item) for item in items)), None)


def _fits(schema: type, value: Any) -> bool:
    """Whether Drake's loader takes a value for a field of a plain type."""
    if type(value) is schema:
        return True
    if schema is bool:
        return value in ("true", "false")
    if type(value) is float:
        return schema is int and value.is_integer()
    if type(value) is int:
        return schema is float
    try:
        return type(value) is str and schema(value) is not None
    except ValueError:
        return False


def _field_types(schema: type) -> dict:
    """Returns the types of the fields of a dataclass or of a struct of Drake's."""
    if hasattr(schema, "__fields__"):
        return {field.name: field.type for field in schema.__fields__}
    hints = typing.get_type_hints(schema)
    return {field.name: hints[field.name] for field in dc.fields(schema)}
