"""What an entry writes: read from a pipe, so that it cannot take back what it has written."""

import collections
import threading
from pathlib import Path
from typing import BinaryIO

from airrace.league.attempts import MARK

_MOST_ATTEMPTS = 50
_TAIL = 200  # lines that are kept
_LONGEST = 2000  # bytes of a line; a longer one counts as several
_PATIENCE = 5.0  # s for the end of a pipe whose writer has ended


class EntryLog:
    """Reads standard output and error of an entry, in a thread of its own.

    It keeps the attempts, and the last lines; what is between is forgotten.
    """

    def __init__(self, pipe: BinaryIO):
        """Args: pipe: the end to read from; it is closed at its end."""
        self._pipe = pipe
        self._attempts: dict[str, None] = {}
        self._lines: collections.deque[str] = collections.deque(maxlen=_TAIL)
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    @property
    def attempts(self) -> list[str]:
        """What the entry tried that an autonomy must not, each once; see note_attempts()."""
        with self._lock:
            return list(self._attempts)

    @property
    def lines(self) -> list[str]:
        """The last lines that it wrote, without attempts and without those that are empty."""
        with self._lock:
            return list(self._lines)

    def wait(self) -> None:
        """Waits until all has been read that an entry wrote before its end."""
        self._thread.join(_PATIENCE)

    def save(self, path: Path) -> None:
        """Writes the last lines to a file."""
        path.write_text("".join(f"{line}\n" for line in self.lines), encoding="utf-8")

    def _read(self) -> None:
        with self._pipe as pipe:
            while line := pipe.readline(_LONGEST):
                self._keep(line.decode(errors="replace").strip())

    def _keep(self, line: str) -> None:
        with self._lock:
            if line.startswith(MARK):
                if len(self._attempts) < _MOST_ATTEMPTS:
                    self._attempts[line.removeprefix(MARK)] = None
            elif line:
                self._lines.append(line)
