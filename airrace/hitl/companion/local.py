"""The autonomy as a second process on this computer."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from airrace.common.errors import UserError
from airrace.common.processes import child_environment
from airrace.hitl.companion import OUTPUT


class LocalCompanion:
    """This computer; see airrace.hitl.companion.Companion."""

    def __init__(self):
        self._running = []

    def start(
        self, arguments: Sequence[str], files: Mapping[str, bytes], log: Callable[[str], None]
    ) -> "LocalAutonomy":
        """See Companion.start()."""
        try:
            autonomy = LocalAutonomy(arguments, files, log)
        except OSError as e:
            raise UserError(
                f"The autonomy cannot be started here ({e.strerror}); make room in "
                f"{tempfile.gettempdir()}, or end other programs."
            ) from None
        self._running.append(autonomy)
        return autonomy

    def close(self) -> None:
        """See Companion.close()."""
        for autonomy in self._running:
            autonomy.stop()
            autonomy.remove()
        self._running.clear()


class LocalAutonomy:
    """A process of this computer; see airrace.hitl.companion.Autonomy."""

    def __init__(self, arguments, files, log):
        """Starts it. Args: see Companion.start(). Raises: OSError."""
        self._log = log
        self._folder = Path(tempfile.mkdtemp(prefix="airrace-"))
        try:
            (self._folder / OUTPUT).mkdir()
            for name, contents in files.items():
                path = self._folder / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(contents)
            # Two files, not a pipe: nobody waits for anybody, and nothing is torn.
            self._written = open(self._folder / "log", "wb")
            self._process = subprocess.Popen(
                [sys.executable, "-u", "-m", "airrace.diagrams.hitl", *arguments],
                cwd=self._folder,
                stdin=subprocess.DEVNULL,
                stdout=self._written,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                env=child_environment(),
            )
        except BaseException:
            self.remove()
            raise
        self._lines = open(self._folder / "log", encoding="utf-8", errors="replace")
        self._rest = ""

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    def poll(self) -> int | None:
        """See Autonomy.poll()."""
        code = self._process.poll()  # first, so that the last lines are read after the end
        *lines, self._rest = (self._rest + self._lines.read()).split("\n")
        if code is not None and self._rest:
            lines, self._rest = [*lines, self._rest], ""
        for line in lines:
            self._log(line)
        return code

    def stop(self, timeout: float = 5.0) -> None:
        """See Autonomy.stop()."""
        for signum, patience in ((signal.SIGTERM, timeout), (signal.SIGKILL, 5.0)):
            if self._process.poll() is None:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(self._process.pid, signum)
                with contextlib.suppress(subprocess.TimeoutExpired):
                    self._process.wait(patience)
        self.poll()

    def wait(self, timeout: float) -> int | None:
        """Waits for the end, at most some time (s); returns what poll() does."""
        end = time.monotonic() + timeout
        while (code := self.poll()) is None and time.monotonic() < end:
            time.sleep(0.02)
        return code

    def collect(self, folder: Path) -> None:
        """See Autonomy.collect()."""
        try:
            shutil.copytree(self._folder / OUTPUT, folder, dirs_exist_ok=True)
        except (OSError, shutil.Error):
            raise UserError(
                f"What the autonomy wrote cannot be copied to {folder}; make room there."
            ) from None

    def remove(self) -> None:
        """Removes its working directory."""
        shutil.rmtree(self._folder, ignore_errors=True)
