"""What a vector port shows, at a glance."""


def read_vector(port, context):
    """Returns what an input port shows, (n,): as its Eval(), but not a copy of it.

    The copy is a third of what it costs to hand a vector to a system in Python, and some
    are handed over at every step of the plant.

    Args:
        port: a vector-valued InputPort. context: of its system.

    Returns:
        an array that is not to be written to, nor kept: it is Drake's own memory.
    """
    return port.EvalBasicVector(context).value()
