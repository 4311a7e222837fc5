"""Where Python looks for modules: never in the folder that somebody happens to work in.

`python -m` looks there before it looks among its own modules, so a folder called `yaml`, handed in
by somebody else, would be run. The working folder counts only for systems that a scenario names,
and then last. This file is read before that is mended: it imports nothing that has a file.
"""

import os
import sys

_ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
_own_systems: str | None = None  # a child's folder of own systems; None: the working folder


def forget_working_folder() -> None:
    """Takes the working folder off Python's path, and so a checkout's, which pip puts there.

    Modules of airrace are found all the same, by the package, which is there already.
    """
    unwanted = {os.getcwd()}
    if os.path.isfile(os.path.join(_ROOT, "pyproject.toml")):  # it is a checkout
        unwanted.add(_ROOT)
    sys.path[:] = [place for place in sys.path if os.path.abspath(place) not in unwanted]


def own_systems_folder() -> str:
    """Returns where modules are that a scenario names, unless they are on Python's path."""
    return _own_systems or os.getcwd()


def add_own_systems_folder() -> None:
    """Lets Python look there as well, after all other places."""
    if own_systems_folder() not in map(os.path.abspath, sys.path):
        sys.path.append(own_systems_folder())


def module_command(module: str, *arguments: str) -> list[str]:
    """Returns the command that runs a module in another process: the `python -m` of children.

    It finds what this process does, wherever it is started, but nothing for being in its working
    folder.
    """
    found = {os.path.abspath(place): None for place in sys.path}  # in this order
    found.pop(os.getcwd(), None)
    places = own_systems_folder(), os.pathsep.join(found)
    return [sys.executable, "-P", "-u", __file__, *places, module, *arguments]


def run_module() -> None:
    """Runs a module in a child: what module_command() says."""
    import runpy

    global _own_systems
    _, _own_systems, path, module, *arguments = sys.argv
    sys.argv = [module, *arguments]
    forget_working_folder()
    sys.path += [place for place in path.split(os.pathsep) if place not in sys.path]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":  # in a child, by its file
    from importlib.machinery import PathFinder
    from importlib.util import module_from_spec

    # airrace is that of this file, and nothing is put on the path for it.
    spec = PathFinder.find_spec("airrace", [_ROOT])
    assert spec is not None and spec.loader is not None
    sys.modules["airrace"] = package = module_from_spec(spec)
    spec.loader.exec_module(package)
    from airrace.common import python_path

    python_path.run_module()
