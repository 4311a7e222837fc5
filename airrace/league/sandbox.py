"""The wall around an entry: bubblewrap, with nothing inside but what an autonomy needs.

Inside there are the system's libraries, this Python with its packages, airrace without its tracks,
the entry's own folder, and a /tmp that nobody else sees. All but /tmp is read-only. There is no
network, no process of others, no environment variable of ours, and one socket, handed over by us.
"""

import contextlib
import functools
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numba

import airrace
from airrace.common.errors import UserError
from airrace.common.patience import patient
from airrace.common.processes import ONE_THREAD, child_environment
from airrace.common.resources import models_path
from airrace.league.season import Limits
from airrace.league.system_calls import make_filter

TOLD, LOG = "told", "log"  # in a race's folder: what the entry is given, and what it writes
RACE = "/race"  # where the entry finds its scenario, track and folder
MACHINE_CODE = "/tmp/machine_code"
_MODULE = "airrace.league.entry_process"
# Of the system; those that a computer does not have are left out.
_SYSTEM = (
    "/usr",
    "/lib",
    "/lib64",
    "/bin",
    "/etc/ld.so.cache",
    "/etc/alternatives",
    "/etc/localtime",
)
_PROBE = 20.0  # s
_END = 5.0  # s that it has to end by itself


class Wall(NamedTuple):
    """What holds an entry.

    Attributes:
        safe: whether there is a wall at all.
        limits: of the season.
    """

    safe: bool
    limits: Limits


@functools.cache
def why_no_sandbox() -> str | None:
    """Returns a clause on why this computer offers no sandbox, or None if it does."""
    if sys.platform != "linux":
        return "bubblewrap is for Linux"
    if shutil.which("bwrap") is None:
        return "bubblewrap is missing ('sudo apt-get install bubblewrap')"
    if make_filter() is None:
        return "the system calls of this processor are not known to the league"
    command = [*_bubblewrap(), "--ro-bind", "/", "/", "--proc", "/proc", "--", "true"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=patient(_PROBE))
    except (OSError, subprocess.TimeoutExpired):
        return "bubblewrap does not run"
    if done.returncode == 0:
        return None
    said = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
    return f"the kernel does not allow it here ({said})"


def check_sandbox(unsafe: bool) -> None:
    """Raises UserError if entries would fly without a wall and nobody has agreed to that."""
    reason = why_no_sandbox()
    if reason is not None and not unsafe:
        raise UserError(
            f"Entries cannot be isolated on this computer: {reason}; mend that, or add --unsafe "
            "if you trust the code of every entry as your own."
        )


class EntryProcess:
    """The process of an entry.

    Attributes:
        pid: of the process, as this side sees it.
    """

    def __init__(self, folder: Path, end: socket.socket, wall: Wall):
        """Starts it.

        Args:
            folder: of the race, with TOLD in it; LOG is made there.
            end: of a SocketBus; the entry's, which is closed on this side.
            wall: around it.

        Raises:
            UserError: if it cannot be started.
        """
        self._folder = folder
        self._scratch: Path | None = None
        arguments = [sys.executable, "-u", "-m", _MODULE, str(end.fileno())]
        arguments.append(str(wall.limits.memory if wall.safe else 0))
        try:
            with end, open(folder / LOG, "wb") as log:
                start = self._start_inside if wall.safe else self._start_outside
                start(arguments, end, log, wall)
        except OSError as e:
            raise UserError(
                f"The process of the entry cannot be started ({e.strerror}); end other programs."
            ) from None

    def _start_outside(self, arguments, end, log, wall):
        race = self._folder / TOLD
        self._process = subprocess.Popen(
            [*arguments, str(race)],
            cwd=race,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            pass_fds=(end.fileno(),),
            start_new_session=True,
            env={**child_environment(), **ONE_THREAD, "PYTHONDONTWRITEBYTECODE": "1"},
        )
        self.pid = self._process.pid

    def _start_inside(self, arguments, end, log, wall):
        # Machine code is compiled once for all, but each entry has its own copy: it may write.
        self._scratch = Path(tempfile.mkdtemp(prefix="airrace-"))
        code = self._scratch / "machine_code"
        shutil.copytree(numba.config.CACHE_DIR, code)
        filter_file = self._scratch / "filter"
        filter_file.write_bytes(make_filter() or b"")
        status, told = os.pipe()
        with open(filter_file, "rb") as rules, open(status, encoding="utf-8") as reader:
            mounts = _mounts(self._folder, code, wall.limits)
            command = [*_bubblewrap(), *mounts, "--seccomp", str(rules.fileno())]
            command += ["--json-status-fd", str(told), "--", *arguments, RACE]
            try:
                self._process = subprocess.Popen(
                    command,
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    pass_fds=(end.fileno(), rules.fileno(), told),
                    start_new_session=True,
                )
            finally:
                os.close(told)
            line = reader.readline()  # empty if it has failed; its log says why
            self.pid = json.loads(line)["child-pid"] if line else self._process.pid

    def poll(self) -> int | None:
        """Returns its exit code, None while it runs."""
        return self._process.poll()

    def lines(self) -> Iterator[str]:
        """Yields the lines that it has written so far, without those that are empty."""
        with open(self._folder / LOG, encoding="utf-8", errors="replace") as log:
            yield from filter(None, map(str.strip, log))

    def cpu_time(self) -> float:
        """Returns the processor time of all its threads so far (s); 0 if it has ended."""
        # The clock of a process, see clock_getcpuclockid(3), which Python has for threads only.
        try:
            return time.clock_gettime((~self.pid << 3) | 2)
        except OSError:
            return 0.0

    def close(self) -> None:
        """Waits a moment for its end, ends it, and removes what it has left."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_END)
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        if self._scratch is not None:
            shutil.rmtree(self._scratch, ignore_errors=True)


def _bubblewrap() -> list[str]:
    return [
        *("bwrap", "--unshare-all", "--die-with-parent", "--new-session", "--as-pid-1"),
        *("--cap-drop", "ALL"),
    ]


def _mounts(folder: Path, code: Path, limits: Limits) -> list[str]:
    """Returns the options of bubblewrap that say what there is inside.

    Args:
        folder: of the race.
        code: a copy of the machine code, which may be written to.
        limits: of the season.
    """
    package, models = Path(airrace.__file__).resolve().parent, models_path()
    mounts = []
    for path in _SYSTEM:
        mounts += ["--ro-bind-try", path, path]
    for place in dict.fromkeys([sys.base_prefix, sys.prefix, str(package), str(models)]):
        mounts += ["--ro-bind", place, place]
    for secret in ("tracks", "entries"):
        mounts += ["--tmpfs", str(models / secret), "--remount-ro", str(models / secret)]
    mounts += ["--proc", "/proc", "--dev", "/dev"]
    mounts += ["--size", str(int(limits.disk * 1e9)), "--tmpfs", "/tmp"]
    mounts += ["--bind", str(code), MACHINE_CODE, "--ro-bind", str(folder / TOLD), RACE]
    mounts += ["--chdir", RACE, "--hostname", "airrace", "--clearenv"]
    environment = {
        **ONE_THREAD,
        "HOME": "/tmp",
        "PATH": "/usr/bin:/bin",
        "LANG": "C.UTF-8",
        "NUMBA_CACHE_DIR": MACHINE_CODE,
        "PYTHONDONTWRITEBYTECODE": "1",
        "PYTHONPATH": f"{package.parent}",
    }
    for name, value in environment.items():
        mounts += ["--setenv", name, value]
    return mounts
