"""Ctrl-C and SIGTERM at times when they do no harm."""

import contextlib
import signal
import types
from collections.abc import Iterator


@contextlib.contextmanager
def interrupt_flag() -> Iterator[types.SimpleNamespace]:
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


@contextlib.contextmanager
def sigterm_as_ctrl_c() -> Iterator[None]:
    """Lets SIGTERM end the block by KeyboardInterrupt, so that everything is tidied up.

    In the main thread only.
    """
    previous = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous)


@contextlib.contextmanager
def interrupts_held() -> Iterator[None]:
    """Keeps Ctrl-C and SIGTERM until the block has ended. In the main thread only."""
    held = []
    previous = {
        number: signal.signal(number, lambda number, frame: held.append(number))
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
    if held:
        signal.raise_signal(held[0])
