"""How an entry is held: bubblewrap, with nothing inside but what an autonomy needs.

Inside there are the system's libraries, this Python with its packages, airrace without its tracks,
the entry's own folder, and a /tmp that nobody else sees. All but /tmp is read-only, and that is
small. There is no network, no process of others, no environment variable of ours, one socket,
handed over by us, and a pipe for what it writes.
"""

import collections
import contextlib
import dataclasses as dc
import functools
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import BinaryIO

import numba

from airrace.common.errors import UserError
from airrace.common.patience import patient
from airrace.common.processes import ONE_THREAD
from airrace.common.python_path import module_command
from airrace.common.resources import PACKAGE, models_path
from airrace.common.words import printable
from airrace.league.attempts import MARK
from airrace.league.season import Limits
from airrace.league.system_calls import make_filter

TOLD = "told"  # in a race's folder: what the entry is given
RACE = "/race"  # where the entry finds its scenario, track and folder
# Machine code is compiled once for all; each entry makes a copy, which it may write to.
MACHINE_CODE, OWN_MACHINE_CODE = "/machine_code", "/tmp/machine_code"
WRITABLE = ("/tmp", "/dev/shm")  # what it may write to: memory, by limits.disk each
HIDDEN = ("tracks", "entries")  # folders of models/ that no entry sees
_MODULE = "airrace.league.entry_process"
_FILTER = "filter"  # file in the race's folder
# Of the system; those that a computer does not have are left out.
_SYSTEM = (
    *("/usr", "/lib", "/lib64", "/bin"),
    *("/etc/ld.so.cache", "/etc/alternatives", "/etc/localtime"),
)
_PROBE = 20.0  # s
_LOOKS = 0.5  # s from one look at what it has to the next
_END = 5.0  # s that it has to end by itself
_MOST_ATTEMPTS = 50
_TAIL = 200  # lines that are kept
_LONGEST = 2000  # bytes of a line; a longer one counts as several
_PATIENCE = 5.0  # s for the end of a pipe whose writer has ended


@dc.dataclass
class SandboxConfig:
    """How an entry is held."""

    safe: bool = True  # whether there is a sandbox at all
    replay: bool = True  # whether a replay of the race is kept
    limits: Limits = dc.field(default_factory=Limits)  # of the season


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
    """Raises UserError if entries would fly without a sandbox and nobody has agreed to that."""
    reason = why_no_sandbox()
    if reason is not None and not unsafe:
        raise UserError(
            f"Entries cannot be isolated on this computer: {reason}; mend that, or add --unsafe "
            "if you trust the code of every entry as your own."
        )


class EntryLog:
    """Reads what an entry writes from a pipe, in a thread: it cannot take back what it has written.

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
            while read := pipe.readline(_LONGEST):
                line = printable(read.decode(errors="replace")).strip()
                with self._lock:
                    if not line.startswith(MARK):
                        self._lines += [line] if line else []
                    elif len(self._attempts) < _MOST_ATTEMPTS:
                        self._attempts[line.removeprefix(MARK)] = None


class EntryProcess:
    """The process of an entry.

    Attributes:
        pid: of the process, as this side sees it.
        log: what it writes.
    """

    def __init__(self, folder: Path, end: socket.socket, sandbox: SandboxConfig):
        """Starts it.

        Args:
            folder: of the race, with TOLD in it.
            end: of a SocketBus; the entry's, which is closed on this side.

        Raises UserError if it cannot be started.
        """
        self._sandbox, self._next_look = sandbox, 0.0
        limits = sandbox.limits
        arguments = [str(end.fileno()), str(limits.memory if sandbox.safe else 0)]
        arguments.append(str(limits.threads))
        try:
            with end:
                start = _start_inside if sandbox.safe else _start_outside
                self._process, self.pid = start(arguments, end, folder, sandbox.limits)
        except OSError as e:
            raise UserError(
                f"The process of the entry cannot be started ({e.strerror}); end other programs."
            ) from None
        self.log = EntryLog(self._process.stdout)

    def poll(self) -> int | None:
        """Returns its exit code, None while it runs."""
        return self._process.poll()

    def cpu_time(self) -> float:
        """Returns the processor time of all its threads so far (s); 0 if it has ended."""
        # The clock of a process, see clock_getcpuclockid(3), which Python has for threads only.
        try:
            return time.clock_gettime((~self.pid << 3) | 2)
        except OSError:
            return 0.0

    def excess(self) -> str | None:
        """Returns a clause on what it has too much of, or None; it looks now and then only."""
        now = time.monotonic()
        if not self._sandbox.safe or now < self._next_look:
            return None
        self._next_look = now + _LOOKS
        return excess_of(self.pid, self._sandbox.limits)

    def close(self) -> None:
        """Waits a moment for its end, and ends it."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_END)
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self.log.wait()


def excess_of(pid: int, limits: Limits) -> str | None:
    """Returns a clause on what a process in a sandbox has more of than it may, or None.

    That is what the kernel does not refuse: to root, threads; to anybody, empty files.
    """
    with contextlib.suppress(OSError):  # it has ended
        if len(os.listdir(f"/proc/{pid}/task")) > limits.threads:
            return f"it has more than {limits.threads} threads"
        for place in WRITABLE:
            there = os.statvfs(f"/proc/{pid}/root{place}")
            if there.f_files - there.f_ffree > limits.files:
                return f"it has more than {limits.files} files in {place}"
    return None


def _start_outside(arguments, end, folder, limits):
    """Starts an entry without a sandbox; returns the process and its number."""
    process = subprocess.Popen(
        module_command(_MODULE, *arguments, str(folder / TOLD)),
        cwd=folder / TOLD,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        pass_fds=(end.fileno(),),
        start_new_session=True,
        env={**os.environ, **ONE_THREAD, "PYTHONDONTWRITEBYTECODE": "1"},
    )
    return process, process.pid


def _start_inside(arguments, end, folder, limits):
    """Starts an entry in the sandbox; returns the process of bubblewrap and the entry's number."""
    filter_file = folder / _FILTER
    filter_file.write_bytes(make_filter() or b"")
    status, told = os.pipe()
    with open(filter_file, "rb") as rules, open(status, encoding="utf-8") as reader:
        command = [*_bubblewrap(), *_mounts(folder, limits), "--seccomp", str(rules.fileno())]
        command += ["--json-status-fd", str(told), "--"]
        command += [sys.executable, "-P", "-u", "-m", _MODULE, *arguments, RACE]
        try:
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                pass_fds=(end.fileno(), rules.fileno(), told),
                start_new_session=True,
            )
        finally:
            os.close(told)
        line = reader.readline()  # empty if it has failed; its log says why
    return process, json.loads(line)["child-pid"] if line else process.pid


def _bubblewrap() -> list[str]:
    return [
        *("bwrap", "--unshare-all", "--die-with-parent", "--new-session", "--as-pid-1"),
        *("--cap-drop", "ALL"),
    ]


def _mounts(folder: Path, limits: Limits) -> list[str]:
    """Returns the options of bubblewrap that say what there is inside."""
    package, models = PACKAGE, models_path()
    mounts = []
    for path in _SYSTEM:
        mounts += ["--ro-bind-try", path, path]
    mounts += ["--proc", "/proc", "--dev", "/dev", "--remount-ro", "/dev"]
    for place in WRITABLE:  # before what may be in /tmp
        mounts += ["--size", str(int(limits.disk * 1e9)), "--tmpfs", place]
    for place in dict.fromkeys([sys.base_prefix, sys.prefix, str(package), str(models)]):
        mounts += ["--ro-bind", place, place]
    for hidden in HIDDEN:
        mounts += ["--tmpfs", str(models / hidden), "--remount-ro", str(models / hidden)]
    mounts += ["--ro-bind", numba.config.CACHE_DIR, MACHINE_CODE]
    mounts += ["--ro-bind", str(folder / TOLD), RACE, "--remount-ro", "/"]
    mounts += ["--chdir", RACE, "--hostname", "airrace", "--clearenv"]
    environment = {
        **ONE_THREAD,
        "HOME": "/tmp",
        "PATH": "/usr/bin:/bin",
        "LANG": "C.UTF-8",
        "NUMBA_CACHE_DIR": OWN_MACHINE_CODE,
        "PYTHONDONTWRITEBYTECODE": "1",
        "PYTHONPATH": f"{package.parent}",
    }
    for name, value in environment.items():
        mounts += ["--setenv", name, value]
    return mounts
