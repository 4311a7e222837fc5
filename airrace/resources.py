"""Finds the files under ``models/`` and loads YAML into dataclasses."""

import functools
from pathlib import Path

import yaml
from pydrake.common.yaml import yaml_load_typed

from airrace.errors import UserError


@functools.cache
def models_path() -> Path:
    """Returns the folder of models, tracks and scenarios.

    It lies inside the package in an installed airrace and beside it in a
    checkout.
    """
    package = Path(__file__).resolve().parent
    for candidate in (package / "models", package.parent / "models"):
        if (candidate / "package.xml").is_file():
            return candidate
    raise UserError(
        f"airrace's models folder is missing beside {package}; "
        "clone or install airrace again."
    )


def find_yaml(kind: str, name_or_file: str) -> Path:
    """Returns the path of a shipped YAML file by name, or of any by path.

    Args:
        kind: the folder below ``models/``: ``"tracks"`` or ``"scenarios"``.
        name_or_file: a bare name such as ``student-airrace``, or a file.

    Raises:
        UserError: if there is neither.
    """
    shipped = models_path() / kind / f"{name_or_file}.yaml"
    if "/" not in name_or_file and shipped.is_file():
        return shipped
    path = Path(name_or_file)
    if path.is_file():
        return path
    names = ", ".join(sorted(p.stem for p in shipped.parent.glob("*.yaml")))
    raise UserError(
        f"There is no {kind.removesuffix('s')} named '{name_or_file}' and no "
        f"such file; the shipped {kind} are: {names}."
    )


def load_yaml(schema, *, filename=None, data=None, **kwargs):
    """Loads YAML with Drake's ``yaml_load_typed``; bad files raise UserError.

    Args:
        schema: the dataclass to load.
        filename: the file to read, or
        data: the text to read.
        kwargs: passed on (``child_name``, ``defaults``).

    Raises:
        UserError: naming the file and what is wrong with it.
    """
    source = str(filename) if filename is not None else f"the text '{data}'"
    try:
        return yaml_load_typed(
            schema=schema, filename=filename and str(filename), data=data, **kwargs
        )
    except UnicodeDecodeError:
        raise UserError(f"{source} is not a text file; give a YAML file.") from None
    except OSError as e:
        raise UserError(f"{source} cannot be read: {e.strerror}.") from None
    except yaml.YAMLError as e:
        mark = getattr(e, "problem_mark", None)
        where = f" at line {mark.line + 1}" if mark else ""
        problem = getattr(e, "problem", None) or "it cannot be parsed"
        raise UserError(f"{source} is not valid YAML{where}: {problem}.") from None
    except Exception as e:  # Drake's loader raises bare RuntimeError, KeyError, ...
        reason = " ".join(str(e).split()).strip("'\"").rstrip(".")
        raise UserError(f"{source} does not fit its schema: {reason}.") from None
