"""The autonomy as a second process on this computer."""

import contextlib
import os
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from airrace.common.errors import UserError
from airrace.common.held_folders import temporary_folder
from airrace.common.patience import patient
from airrace.common.python_path import module_command
from airrace.hitl.companion import OUTPUT, PARENT, Autonomy, Companion


class LocalCompanion(Companion):
    """This computer."""

    def start(
        self, arguments: Sequence[str], files: Mapping[str, bytes], log: Callable[[str], None]
    ) -> "LocalAutonomy":
        held = contextlib.ExitStack()
        try:
            folder = held.enter_context(temporary_folder())
            (folder / OUTPUT).mkdir()
            for name, contents in files.items():
                path = folder / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.touch(0o600)  # one may be a key
                path.write_bytes(contents)
            self._running.append(LocalAutonomy(arguments, folder, held, log))
        except OSError as e:
            held.close()
            raise UserError(
                f"The autonomy cannot be started here ({e.strerror}); make room in "
                f"{tempfile.gettempdir()}, or end other programs."
            ) from None
        return self._running[-1]


class LocalAutonomy(Autonomy):
    """A process of this computer."""

    def __init__(
        self,
        arguments: Sequence[str],
        folder: Path,
        held: contextlib.ExitStack,
        log: Callable[[str], None],
    ):
        """Starts it in its working directory, with its files there; may raise OSError.

        Args: arguments: of its command line. folder: the directory. held: removes it. log: is
        called with what it says.
        """
        self._log, self._folder, self._held, self._rest = log, folder, held, ""
        # A file, not a pipe: neither side waits for the other.
        with open(folder / "log", "wb") as written:
            self._process = subprocess.Popen(
                module_command("airrace.hitl", "autonomy", *arguments),
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stdout=written,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                env={**os.environ, PARENT: str(os.getpid())},
            )
        self._lines = open(folder / "log", encoding="utf-8", errors="replace")

    def poll(self) -> int | None:
        code = self._process.poll()  # first, so that the last lines are read after the end
        *lines, self._rest = (self._rest + self._lines.read()).split("\n")
        if code is not None and self._rest:
            lines, self._rest = [*lines, self._rest], ""
        for line in lines:
            self._log(line)
        return code

    def stop(self, timeout: float = 5.0) -> None:
        for signum, patience in ((signal.SIGTERM, timeout), (signal.SIGKILL, 5.0)):
            if self._process.poll() is None:
                self._signal_group(signum)
                with contextlib.suppress(subprocess.TimeoutExpired):
                    self._process.wait(patient(patience))
        self._signal_group(signal.SIGKILL)  # workers that it has left behind
        self.poll()

    def _signal_group(self, signum):
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signum)

    def collect(self, folder: Path) -> None:
        try:
            shutil.copytree(self._folder / OUTPUT, folder, dirs_exist_ok=True)
        except (OSError, shutil.Error):
            raise UserError(
                f"What the autonomy wrote cannot be copied to {folder}; make room there."
            ) from None

    def remove(self) -> None:
        self._lines.close()
        self._held.close()
