"""Other Python processes of this computer."""

import os
import sys

# For an environment: where processes share the cores, the threads of their numerical
# libraries would only wait for one another.
ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "OPENCV_FOR_THREADS_NUM": "1",
}


def child_environment() -> dict[str, str]:
    """Returns the environment in which an interpreter finds what this one does.

    That is airrace, and the modules that a scenario names, wherever its working folder is.
    """
    found = os.pathsep.join(path or os.getcwd() for path in sys.path)
    return {**os.environ, "PYTHONPATH": found}
