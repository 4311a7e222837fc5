"""Names what an entry tries that the sandbox would not let through.

Python tells an audit hook (PEP 578) of each file, socket and process before there is one. The hook
only writes a line; what refuses is the sandbox. An entry in machine code of its own can go unseen.
"""

import os
import sys
from typing import NamedTuple

MARK = "airrace-attempt: "  # begins the line of an attempt
_MOST = 50  # lines
_PROCESSES = ("os.fork", "os.forkpty", "os.posix_spawn", "os.exec", "os.system", "subprocess.Popen")
_SIMULATOR = ("airrace.diagrams.simulation", "airrace.diagrams.race", "airrace.league.entry_race")
# What this Python itself reads to start, and what libraries ask about the processor and memory.
_HARMLESS = (
    *("/dev/null", "/dev/urandom"),
    *("/proc/self", "/proc/cpuinfo", "/proc/meminfo", "/proc/stat"),
)
_SYSTEM = ("/usr", "/lib", "/lib64", "/etc", "/bin", "/sys/devices/system/cpu")


class Allowed(NamedTuple):
    """Folders that an entry may use; what is in them, it may use as well."""

    read: tuple[str, ...]  # from which it may read
    write: tuple[str, ...]  # which it may read and write
    hidden: tuple[str, ...] = ()  # within those of ``read`` or ``write``, which it may not use


def note_attempts(allowed: Allowed) -> None:
    """From now on writes a line to standard output for every attempt, once each.

    Args: allowed: beside the system's libraries and this Python with its packages.
    """
    read = (sys.prefix, sys.base_prefix, *allowed.read, *_SYSTEM)
    # To import a module, Python lists the folders of its path anew when one of them has changed.
    listed = frozenset(map(os.path.abspath, sys.path))
    roots = allowed._replace(read=read)
    out, seen = os.dup(1), set()
    is_busy = False

    def hook(event, arguments):
        nonlocal is_busy
        if is_busy or len(seen) >= _MOST:
            return
        attempt = _attempt(event, arguments, roots, listed)
        if attempt is None or attempt in seen:
            return
        seen.add(attempt)
        is_busy = True
        try:
            os.write(out, f"\n{MARK}{' '.join(attempt.split())[:200]}\n".encode())
        finally:
            is_busy = False

    sys.addaudithook(hook)


def _attempt(event: str, arguments: tuple, allowed: Allowed, listed: frozenset[str]) -> str | None:
    """Returns what was tried, or None if an autonomy may well do that."""
    if event == "open":
        return _opened(arguments[0], arguments[1], arguments[2], allowed)
    if event == "os.listdir" and arguments and isinstance(arguments[0], str):
        if os.path.abspath(arguments[0]) in listed:
            return None
        return _opened(arguments[0], "r", 0, allowed)
    if event == "socket.__new__":
        return "opened a socket"
    if event in _PROCESSES:
        return f"started a process ({event})"
    if event == "import" and arguments[0] in _SIMULATOR:
        return f"imported {arguments[0]}, which knows nothing of this race"
    return None


def _opened(path: object, mode: str | None, flags: int, allowed: Allowed) -> str | None:
    if not isinstance(path, (str, bytes)):
        return None
    path = os.path.abspath(os.fsdecode(path))
    writes = bool(flags & (os.O_WRONLY | os.O_RDWR)) or any(c in (mode or "") for c in "wax+")
    is_hidden = _is_in(path, allowed.hidden)  # also in a folder that may be written to
    if not is_hidden and (_is_in(path, allowed.write) or path == "/dev/null"):
        return None
    if writes:
        return f"wrote to {path}"
    if not is_hidden and (_is_in(path, _HARMLESS) or _is_in(path, allowed.read)):
        return None
    return f"read {path}"


def _is_in(path: str, places: tuple[str, ...]) -> bool:
    """Whether a path is one of some files or folders, or in one."""
    return any(path == place or path.startswith(place + "/") for place in places)
