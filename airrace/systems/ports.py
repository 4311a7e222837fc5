"""Reading vector ports without a copy."""

import numpy as np
from pydrake.systems.framework import Context, InputPort


def read_or(default: np.ndarray, port: InputPort, context: Context) -> np.ndarray:
    """Returns the value of an input port, see read_vector(); a default if it was left open."""
    return read_vector(port, context) if port.HasValue(context) else default


def read_vector(port: InputPort, context: Context) -> np.ndarray:
    """Returns the value of an input port, (n,): like its Eval(), but not a copy.

    The copy is a third of the cost of reading a vector in Python, and some are read at
    every step of the plant.

    Args: port: a vector-valued InputPort. context: of its system.

    Returns: an array that must be neither written to nor kept: it is Drake's own memory.
    """
    return port.EvalBasicVector(context).value()
