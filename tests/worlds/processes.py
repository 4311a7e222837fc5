"""Programs that tests start, watch and kill."""

import contextlib
import time
from collections.abc import Callable
from typing import Any

import psutil


def wait_until(condition: Callable[[], Any], seconds: float = 60.0) -> Any:
    """Waits until a condition is true, which must be soon (s); returns what it is then."""
    deadline = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    return found


def descendant(process: Any, word: str) -> psutil.Process | None:
    """Returns the first descendant of a process that has a word in its command, or None."""
    with contextlib.suppress(psutil.Error):
        for child in psutil.Process(process.pid).children(recursive=True):
            with contextlib.suppress(psutil.Error):
                if word in child.cmdline():
                    return child
    return None
