"""Where the autonomy runs in HITL: a process on this computer, or on another one.

Whoever starts it needs no more than this of a companion:

    with contextlib.closing(companion):
        autonomy = companion.start(["--role", "autonomy", ...], files, print)
        while autonomy.poll() is None: ...
        autonomy.stop()
        autonomy.collect(folder)
"""

import abc
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

# The folder, in the one that start() makes, that the autonomy writes to.
OUTPUT = "output"
# The variable with the number of the process that an autonomy on this computer ends with.
PARENT = "AIRRACE_PARENT"
# What the autonomy prints on a line of its own once it listens.
READY = "airrace: autonomy ready"


class Autonomy(abc.ABC):
    """An autonomy that was started."""

    @abc.abstractmethod
    def poll(self) -> int | None:
        """Hands new lines of its output to the log; returns its exit code, None while it runs.

        Never blocks, and never raises. An autonomy that cannot be reached any more may still
        fly: it counts as running until it is told to stop, and then as ended with -1. The exit
        codes are 0 after the race, 3 if the simulation fell silent, 4 if its navigator died, 1
        when told to stop, 2 on bad input (its last line says what).
        """

    @abc.abstractmethod
    def stop(self, timeout: float = 5.0) -> None:
        """Ends it, if it runs: SIGTERM, and after the timeout (s) SIGKILL, to its process group."""

    @abc.abstractmethod
    def collect(self, folder: Path) -> None:
        """Copies its OUTPUT folder into one here, which is made; may raise UserError."""

    @abc.abstractmethod
    def remove(self) -> None:
        """Removes its working directory, unless what is in it could not be fetched."""


class Companion(abc.ABC):
    """A computer that runs the autonomy."""

    def __init__(self) -> None:
        self._running = []  # Autonomies

    @abc.abstractmethod
    def start(
        self, arguments: Sequence[str], files: Mapping[str, bytes], log: Callable[[str], None]
    ) -> Autonomy:
        """Starts ``airrace hitl autonomy`` with some arguments.

        It gets a new folder as its working directory, with the files in it and an empty folder
        OUTPUT, which its arguments name as ``--output``. It is the leader of a process group of its
        own, and ends by itself when the simulation's heartbeats are missing.

        Args:
            arguments: of the command line; may hold anything, so no shell may read them.
            files: relative path with forward slashes to contents: the scenario, and the track,
                drone and Python modules that it names unless they are shipped with airrace.
            log: called by poll() with each line that it prints, without the line's end.

        Raises UserError if it cannot be started, with the remedy.
        """

    def close(self) -> None:
        """Stops what runs, removes the working directories, and disconnects."""
        for autonomy in self._running:
            autonomy.stop()
            autonomy.remove()
        self._running.clear()
