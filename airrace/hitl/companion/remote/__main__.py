"""Does one job on the companion computer: python -m remote.

It reads the job, a line of JSON, on its standard input, and writes what happens
as lines of JSON with the key ``event`` on its standard output:

    missing     {environment, package}: what a set-up would have to make
    step        {text}: what is being done now
    progress    {done, total}: how far that is
    refused     {sentence}: what the user can mend; {host} in it is this machine
    running     {}: the autonomy has been started
    log         {line}: it has written this
    exit        {code}: it has ended
    done        {}: the job is done

Jobs, by their key ``do``: ``look`` says what is missing, ``set-up`` makes it,
``run`` runs the autonomy, and ``stop`` ends one whose connection was lost. The
other keys are the arguments of the functions of the same name.
"""

import contextlib
import json
import os
import sys

from .events import Refused, emit, in_background
from .run import run, stop
from .set_up import die_with_the_connection, look, set_up


def main() -> int:
    """Does the job; returns the exit code."""
    job = json.loads(_read_line())
    do = {"look": look, "set-up": set_up, "run": run, "stop": stop}[job.pop("do")]
    if do is set_up:
        in_background(die_with_the_connection)
    try:
        do(**job)
    except Refused as e:
        emit("refused", sentence=str(e))
        return 2
    with contextlib.suppress(OSError):  # the connection may be lost by now
        emit("done")
    return 0


def _read_line() -> bytes:
    """Reads a line of standard input and not a byte more: what follows is a job's."""
    line = b""
    while not line.endswith(b"\n") and (byte := os.read(0, 1)):
        line += byte
    return line


if __name__ == "__main__":
    sys.exit(main())
