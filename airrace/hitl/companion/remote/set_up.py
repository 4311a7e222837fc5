"""Makes an environment on the companion computer, and installs airrace beside it."""

import contextlib
import errno
import fcntl
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

from .events import Refused, emit, kill_group

_STALE = 60 * 24 * 3600  # s; what was not used for so long is removed
_LITTLE = 20_000_000  # bytes
_PIP = (
    "-I",
    "-m",
    "pip",
    "install",
    "--no-input",
    "--disable-pip-version-check",
    "--no-cache-dir",
    "--only-binary",
    ":all:",
)


def look(cache: str, environment: str, package: str) -> None:
    """Says what set_up() would have to make; arguments as there."""
    venv, code = Path(cache) / "environments" / environment, Path(cache) / "packages" / package
    emit("missing", environment=not _works(venv), package=not _is_complete(code))


def set_up(cache: str, environment: str, package: str, room: int, offline: bool) -> None:
    """Makes what is not there yet: an environment of the lock, and airrace itself.

    Both are complete when the file ``complete`` is in them, which is written last.

    Args:
        cache: the folder of everything that is kept here; in it are
            locks/<environment>.txt, wheels/<package>/*.whl and, if offline,
            wheelhouse/<environment>/*.whl.
        environment: name of the environment: a digest of its lock.
        package: name of airrace's own folder: a digest of its files.
        room: free space that a new environment takes (bytes).
        offline: whether to install from wheelhouse alone.
    """
    cache = Path(cache)
    with _locked(cache / "set-up.lock"):
        venv = cache / "environments" / environment
        try:
            if not _works(venv):
                _make_environment(cache, venv, room, offline)
            _use(venv)
            code = cache / "packages" / package
            if not _is_complete(code):
                emit("step", text="installing this airrace")
                _empty(code)
                [wheel] = (cache / "wheels" / package).glob("*.whl")
                _run(
                    [
                        venv / "bin" / "python",
                        *_PIP,
                        "--no-deps",
                        "--no-index",
                        "--target",
                        code,
                        wheel,
                    ]
                )
            _use(code)
            for kept in ("environments", "packages", "runs"):
                _prune(cache / kept)
        except OSError as e:
            if e.errno in (errno.ENOSPC, errno.EDQUOT):
                raise _disk_full(cache, room) from None
            raise
        for brought in (cache / "wheelhouse" / environment, cache / "wheels" / package):
            shutil.rmtree(brought, ignore_errors=True)


def _make_environment(cache, venv, room, offline):
    if shutil.disk_usage(cache).free < room:
        raise _disk_full(cache, room)
    emit("step", text=f"making an environment with {sys.executable}")
    _empty(venv)
    code, output = _run([sys.executable, "-I", "-m", "venv", "--clear", venv], check=False)
    if code:
        _refuse_full_disk(cache, room, output)
        raise Refused(
            f"Python on {{host}} cannot make virtual environments ({_last(output)}); "
            "run there 'sudo apt-get install python3-venv'."
        )
    emit("step", text="installing requirements.lock")
    lock = cache / "locks" / f"{venv.name}.txt"
    total = sum(bool(line.strip()) and line[0] not in " #" for line in lock.open())
    done = 0

    def count(line):
        nonlocal done
        if line.startswith(("Collecting", "Processing")):
            done += 1
            emit("progress", done=min(done, total), total=total)
        elif line.startswith("Installing collected"):
            emit("step", text="unpacking the wheels")

    source = ["--no-index", "--find-links", cache / "wheelhouse" / venv.name] if offline else []
    code, output = _run(
        [
            venv / "bin" / "python",
            *_PIP,
            "--progress-bar",
            "off",
            "--require-hashes",
            *source,
            "--requirement",
            lock,
        ],
        count,
        check=False,
    )
    if code:
        _refuse_full_disk(cache, room, output)
        raise Refused(
            f"Installing requirements.lock on {{host}} failed ({_last(output)}); "
            + (
                "have a wheel of every locked package for it in the folder of --wheels."
                if offline
                else "connect it to the internet, or bring the wheels along with --wheels."
            )
        )
    code, output = _run([venv / "bin" / "python", "-I", "-c", "import pydrake.common"], check=False)
    if code:
        package = "libglib2.0-0" if "libglib-2.0" in output else "what the message names"
        raise Refused(
            f"Drake cannot be imported on {{host}} ({_last(output)}); install "
            f"{package} there with 'sudo apt-get install'."
        )


def _last(output: str) -> str:
    """Returns the last line of a program's output that says something, not too long."""
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    errors = [line for line in lines if line.startswith("ERROR")]
    text = (errors or lines or ["it says nothing"])[-1].removeprefix("ERROR: ")
    return text.rstrip(".")[:300].replace("{", "(").replace("}", ")")


def _refuse_full_disk(cache, room, output):
    said = "No space left" in output or "Disk quota exceeded" in output
    if said or shutil.disk_usage(cache).free < _LITTLE:  # not every program says why it fails
        raise _disk_full(cache, room)


def _disk_full(cache, room):
    free = shutil.disk_usage(cache).free
    return Refused(
        f"The disk of {{host}} is full: {free / 1e9:.1f} GB are free in {cache}, and "
        f"airrace takes {room / 1e9:.1f} GB; make room there."
    )


def _is_complete(folder: Path) -> bool:
    return (folder / "complete").exists()


def _works(venv: Path) -> bool:
    """Whether an environment is complete, and its Python has not been removed since."""
    find = "import importlib.util, sys; sys.exit(importlib.util.find_spec('pydrake') is None)"
    return _is_complete(venv) and not _run([venv / "bin/python", "-I", "-c", find], check=False)[0]


def _use(folder: Path):
    (folder / "complete").touch()  # its time says when it was used last


def _empty(folder: Path):
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)


def _prune(folder: Path):
    for entry in folder.iterdir() if folder.is_dir() else ():
        used = entry / "complete"
        if time.time() - (used if used.exists() else entry).stat().st_mtime > _STALE:
            shutil.rmtree(entry, ignore_errors=True)


@contextlib.contextmanager
def _locked(path: Path):
    """Waits for another set-up here, and keeps others waiting."""
    with path.open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            emit("step", text="waiting for another set-up there")
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


_children = []  # processes to take along when the connection is lost in a set-up


def _run(command, on_line=lambda line: None, check=True):
    """Runs a program; returns its exit code and output."""
    output = []
    try:
        process = subprocess.Popen(
            list(map(str, command)),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
        )
    except OSError as e:
        if check:
            raise
        return 127, str(e)
    _children.append(process)
    try:
        for line in process.stdout:
            output.append(line)
            on_line(line)
        code = process.wait()
    finally:
        kill_group(process.pid, signal.SIGKILL)
        process.wait()
        _children.remove(process)
    if code and check:
        text = "".join(output)
        if "No space left" in text:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        raise RuntimeError(f"{command} failed: {text}")
    return code, "".join(output)


def die_with_the_connection():
    """Ends the process and its children at once when standard input ends."""
    while os.read(0, 4096):
        pass
    for process in list(_children):
        kill_group(process.pid, signal.SIGKILL)
    os._exit(1)
