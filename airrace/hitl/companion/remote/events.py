"""What the companion computer tells the workstation: a line of JSON for each event."""

import contextlib
import json
import os
import signal
import threading


class Refused(Exception):
    """The user can mend it; the message is the sentence of a ``refused`` event."""


def emit(event: str, **values) -> None:
    """Writes an event to standard output.

    Raises:
        OSError: if nobody reads; later events go nowhere, without an error.
    """
    try:
        print(json.dumps({"event": event, **values}), flush=True)
    except OSError:
        with open(os.devnull, "w") as devnull:
            os.dup2(devnull.fileno(), 1)
        raise


def in_background(function, *arguments) -> None:
    """Calls a function in a thread that keeps nothing from ending."""
    threading.Thread(target=function, args=arguments, daemon=True).start()


def kill_group(pid: int, signum: signal.Signals) -> None:
    """Sends a signal to a process and all that it started, if they still are."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(pid, signum)
