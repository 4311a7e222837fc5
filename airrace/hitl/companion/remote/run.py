"""Runs the autonomy on the companion computer, and ends it."""

import contextlib
import fcntl
import os
import signal
import socket
import subprocess
import time
from pathlib import Path

from .events import Refused, emit, in_background, kill_group

_PATIENCE = 5.0  # s from SIGTERM to SIGKILL, unless the workstation says otherwise
_ALONE = 3600.0  # s that an autonomy may run on after the connection was lost


def run(
    cache: str,
    environment: str,
    package: str,
    folder: str,
    arguments: list[str],
    udp_port: int | None,
) -> None:
    """Runs the autonomy until it ends by itself or is told to.

    A line on standard input ends it: the time (s) from SIGTERM to SIGKILL. When
    the connection is lost, it flies on: it notices by itself when nobody listens
    any more. Its output is kept in output/autonomy.log.

    Args:
        cache, environment, package: as for set_up().
        folder: the working directory.
        arguments: of the Python of the environment.
        udp_port: that must be free, or None.
    """
    cache, folder = Path(cache), Path(folder)
    with (cache / "run.lock").open("a+") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.seek(0)
            raise Refused(
                "Another race's autonomy is running on {host}; end that race, or run "
                f"there 'kill {lock.read().strip() or '?'}'."
            ) from None
        lock.truncate(0)
        print(os.getpid(), file=lock, flush=True)
        if udp_port is not None:
            _check_port(udp_port)
        (folder / "output").mkdir(parents=True, exist_ok=True)
        (folder / "pid").write_text(str(os.getpid()))
        # -P is not given: modules brought along lie in the working directory.
        process = subprocess.Popen(
            [cache / "environments" / environment / "bin" / "python", *arguments],
            cwd=folder,
            env={
                **os.environ,
                "PYTHONPATH": str(cache / "packages" / package),
                "PYTHONUNBUFFERED": "1",
                "PYTHONDONTWRITEBYTECODE": "1",
            },
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        signal.signal(signal.SIGTERM, lambda *_: in_background(_end, process))
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        emit("running")
        in_background(_listen, process)
        in_background(_bury, process)
        _forward(process.stdout, folder / "output" / "autonomy.log")
        with contextlib.suppress(OSError):
            emit("exit", code=process.wait())


def _check_port(port):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as LCM does
        try:
            s.bind(("", port))
        except OSError as e:
            raise Refused(
                f"UDP port {port} is in use on {{host}} ({e.strerror}); end what uses "
                "it there, or name another port in --lcm_url."
            ) from None


def _listen(process):
    with os.fdopen(os.dup(0), "rb", buffering=0) as lines:
        line = lines.readline()
    if line:
        _end(process, float(line))
    else:  # the connection was lost
        time.sleep(_ALONE)
        _end(process)


def _bury(process):
    """Ends the workers that a process leaves behind: they would keep its output open."""
    process.wait()
    kill_group(process.pid, signal.SIGKILL)


def _end(process, patience=_PATIENCE):
    kill_group(process.pid, signal.SIGTERM)
    try:
        process.wait(patience)
    except subprocess.TimeoutExpired:
        kill_group(process.pid, signal.SIGKILL)


def _forward(stream, path):
    """Writes a program's output to a file, and sends it as long as somebody reads it."""
    with contextlib.ExitStack() as stack:
        log = None
        with contextlib.suppress(OSError):
            log = stack.enter_context(path.open("ab", buffering=0))
        for line in stream:
            with contextlib.suppress(OSError):  # a full disk ends the log, not the race
                if log is not None:
                    log.write(line)
            with contextlib.suppress(OSError):
                emit("log", line=line.decode(errors="replace").rstrip("\r\n"))


def stop(folder: str, cache: str) -> None:
    """Ends an autonomy that runs on in a folder, and waits for its end."""
    pid = Path(folder) / "pid"
    with (Path(cache) / "run.lock").open("a+") as lock:
        deadline = time.monotonic() + 2 * _PATIENCE
        while time.monotonic() < deadline:
            with contextlib.suppress(BlockingIOError):
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return  # nobody holds it: no autonomy runs
            lock.seek(0)
            if not pid.exists() or lock.read().strip() != pid.read_text():
                return  # another race's
            with contextlib.suppress(ProcessLookupError):
                os.kill(int(pid.read_text()), signal.SIGTERM)
            time.sleep(0.2)
