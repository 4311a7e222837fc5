"""Other Python processes of this computer."""

import os
import sys


def child_environment() -> dict[str, str]:
    """Returns the environment in which an interpreter finds what this one does.

    That is airrace, and the modules that a scenario names, wherever its working folder is.
    """
    found = os.pathsep.join(path or os.getcwd() for path in sys.path)
    return {**os.environ, "PYTHONPATH": found}
