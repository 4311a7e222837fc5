"""Ctrl-C and SIGTERM at times when they do no harm. In the main thread only."""

import contextlib
import signal


@contextlib.contextmanager
def sigterm_as_ctrl_c():
    """Lets SIGTERM end the block by KeyboardInterrupt, so that everything is tidied up."""
    previous = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous)


@contextlib.contextmanager
def interrupts_held():
    """Keeps both signals until the block has ended."""
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
