"""Systems that a scenario names in the place of airrace's own, and what goes wrong in them."""

import importlib
import sysconfig
import traceback
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import NamedTuple

from pydrake.systems.framework import System

from airrace.common.errors import UserError, words
from airrace.common.python_path import add_own_systems_folder
from airrace.common.resources import PACKAGE
from airrace.common.words import printable
from airrace.scenario import Scenario
from airrace.systems.contract import name_of

# Where code is that is nobody's own: airrace, Python's library, and installed packages.
_LIBRARIES = tuple(
    Path(place).resolve()
    for place in (str(PACKAGE), *map(sysconfig.get_path, ("stdlib", "purelib", "platlib")))
)


def make_system(name: str, make: Callable[[Scenario], System], scenario: Scenario) -> System:
    """Makes a system, by the scenario's "module:callable" if it names one.

    Args:
        name: of the system.
        make: what makes it by default.
        scenario: that is given to what makes it.

    Raises:
        UserError: if what the scenario names cannot be had or makes no System.
    """
    if name not in scenario.systems:
        return make(scenario)
    path = scenario.systems[name]
    module, _, attribute = path.partition(":")
    if not (module and attribute):
        raise UserError(
            f"systems.{name}: '{path}' names no callable: write module:callable, such as "
            "my_team:make_controller."
        )
    add_own_systems_folder()
    try:
        make = getattr(importlib.import_module(module), attribute)
    except Exception as e:  # whatever the module does when it is imported
        raise UserError(
            f"systems.{name}: '{path}' cannot be imported as module:callable "
            f"({_described(e)}); check its spelling, the module itself, and PYTHONPATH."
        ) from e
    try:
        system = make(scenario)
    except UserError as e:
        raise UserError(f"systems.{name}: {path}: {e}") from e
    except Exception as e:
        raise UserError(
            f"systems.{name}: {path} cannot be called with the scenario ({_described(e)}); name a "
            "function of it that returns a System, such as my_team:make_controller."
        ) from e
    if not isinstance(system, System):
        raise UserError(
            f"systems.{name}: {path} must return a System, not a {type(system).__name__}."
        )
    return system


class Mistake(NamedTuple):
    """An exception in code of somebody's own."""

    sentence: str  #: what raised which exception, and where; without a full stop
    frames: list[str]  #: lines of the traceback that are of files of their own


def find_mistake(error: BaseException, scenario: Scenario) -> Mistake | None:
    """Returns what went wrong in systems of the scenario's own, or None if it was not there."""
    places = list(traceback.walk_tb(error.__traceback__))
    own = [k for k, (frame, _) in enumerate(places) if _is_own(frame.f_code.co_filename)]
    if not (scenario.systems and own) or isinstance(error, UserError):
        return None
    summary = traceback.StackSummary.extract(iter(places))
    last, kind, said = summary[own[-1]], type(error).__name__, words(error)
    sentence = (
        f"{_caller(places[own[0]][0])}() raised {kind if said == kind else f'{kind}: {said}'} "
        f"({Path(last.filename).name}, line {last.lineno})"
    )
    lines = "".join(traceback.format_list([summary[k] for k in own])).splitlines()
    return Mistake(printable(sentence), [*map(printable, lines)])


def _is_own(file: str) -> bool:
    path = Path(file).resolve()
    return path.is_file() and not any(path.is_relative_to(place) for place in _LIBRARIES)


def _caller(frame: FrameType) -> str:
    """Returns the full name of what runs in a frame: with its object's class, if it is a method."""
    code = frame.f_code
    if "self" in frame.f_locals:
        return f"{name_of(type(frame.f_locals['self']))}.{code.co_name}"
    return f"{frame.f_globals['__name__']}.{code.co_qualname}"


def _described(error: Exception) -> str:
    """Returns what went wrong in a system's own code, and where, on one line."""
    message = " ".join(f"{type(error).__name__}: {error}".split())
    frame = traceback.extract_tb(error.__traceback__)[-1]
    if frame.filename == __file__ or "importlib" in frame.filename:
        return message
    return f"{message}, at {frame.filename}:{frame.lineno}"
