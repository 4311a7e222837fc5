"""Systems that a scenario names in the place of airrace's own."""

import importlib
import traceback
from collections.abc import Callable

from pydrake.systems.framework import System

from airrace.common.errors import UserError
from airrace.common.python_path import add_own_systems_folder
from airrace.scenario import Scenario


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


def _described(error: Exception) -> str:
    """Returns what went wrong in a system's own code, and where, on one line."""
    message = " ".join(f"{type(error).__name__}: {error}".split())
    frame = traceback.extract_tb(error.__traceback__)[-1]
    if frame.filename == __file__ or "importlib" in frame.filename:
        return message
    return f"{message}, at {frame.filename}:{frame.lineno}"
