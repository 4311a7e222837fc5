"""What the results of a race depend on beside its scenario: the code that flies it."""

import importlib.metadata
import sys
from importlib.machinery import PathFinder
from pathlib import Path

from airrace.common.files import digest
from airrace.common.python_path import own_systems_folder
from airrace.common.resources import PACKAGE, models_path

_MISSING = "missing"


def versions(systems: dict) -> dict:
    """Returns names and versions of what flies a race with a scenario's systems in this Python.

    airrace, which may be a checkout with changes, and the modules of systems are
    told apart by the contents of their files.
    """
    import cv2
    import numpy

    result = {
        "airrace": digest(PACKAGE, models_path()),
        "drake": _distribution("drake"),
        "numpy": numpy.__version__,
        "opencv": cv2.__version__,
    }
    for name in sorted({path.partition(":")[0].partition(".")[0] for path in systems.values()}):
        if name != "airrace":
            result[name] = _module_digest(name)
    return result


def mismatch(expected: dict, actual: dict) -> str | None:
    """Returns a clause on the first version that differs, or None."""
    for name, version in expected.items():
        if actual.get(name) != version:
            return f"{name} {actual.get(name, _MISSING)} instead of {version}"
    return None


def _distribution(name):
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "unknown"  # not installed by pip


def _module_digest(name):
    """Finds a module where a race finds it, and does not import it."""
    spec = PathFinder.find_spec(name, [*sys.path, own_systems_folder()])
    if spec is None:
        return _MISSING
    return digest(*map(Path, spec.submodule_search_locations or [spec.origin]))
