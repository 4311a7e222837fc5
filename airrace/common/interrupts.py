"""Ctrl-C and SIGTERM at times when they do no harm."""

import contextlib
import signal
import types


@contextlib.contextmanager
def interrupt_flag():
    """Turns the first Ctrl-C or SIGTERM into a flag; the second one acts as usual.

    In other threads than the main one the flag is never set: signals go elsewhere.

    Yields:
        a namespace with ``is_set``.
    """
    flag = types.SimpleNamespace(is_set=False)
    previous = {}

    def set_flag(signum, frame):
        flag.is_set = True
        signal.signal(signum, previous[signum])

    with contextlib.suppress(ValueError):  # not in the main thread
        for signum in (signal.SIGINT, signal.SIGTERM):
            previous[signum] = signal.signal(signum, set_flag)
    try:
        yield flag
    finally:
        for signum, handler in previous.items():
            signal.signal(signum, handler)
