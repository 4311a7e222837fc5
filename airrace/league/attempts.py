"""Names what an entry tries that the wall would not let through.

Python tells an audit hook (PEP 578) of each file, socket and process before there is one. The hook
only writes a line; what refuses is the wall. An entry in machine code of its own can go unseen.
"""

import os
import sys

MARK = "airrace-attempt: "  # begins the line of an attempt
_MOST = 50  # lines
_PROCESSES = ("os.fork", "os.forkpty", "os.posix_spawn", "os.exec", "os.system", "subprocess.Popen")
_SIMULATOR = ("airrace.diagrams.simulation", "airrace.diagrams.race", "airrace.league.flight")
# What this Python itself reads to start, and what libraries ask about the processor and memory.
_HARMLESS = (
    "/dev/null",
    "/dev/urandom",
    "/proc/self/",
    "/proc/cpuinfo",
    "/proc/meminfo",
    "/proc/stat",
)
_SYSTEM = ("/usr/", "/lib", "/etc/", "/bin/", "/sys/devices/system/cpu")


def report_attempts(race: str) -> None:
    """From now on writes a line to standard output for every attempt, once each.

    Args:
        race: the folder that the entry was given.
    """
    roots = (sys.prefix, sys.base_prefix, _folder_of_airrace(), race, "/tmp", *_SYSTEM)
    out, seen = os.dup(1), set()
    is_busy = False

    def hook(event, arguments):
        nonlocal is_busy
        if is_busy or len(seen) >= _MOST:
            return
        attempt = _attempt(event, arguments, roots)
        if attempt is None or attempt in seen:
            return
        seen.add(attempt)
        is_busy = True
        try:
            os.write(out, f"\n{MARK}{' '.join(attempt.split())[:200]}\n".encode())
        finally:
            is_busy = False

    sys.addaudithook(hook)


def _attempt(event: str, arguments: tuple, roots: tuple) -> str | None:
    """Returns what was tried, or None if an autonomy may well do that."""
    if event == "open":
        return _opened(arguments[0], arguments[1], arguments[2], roots)
    if event == "os.listdir" and arguments and isinstance(arguments[0], str):
        return _opened(arguments[0] + "/", "r", 0, roots)
    if event == "socket.__new__":
        return "opened a socket"
    if event in _PROCESSES:
        return f"started a process ({event})"
    if event == "import" and arguments[0] in _SIMULATOR:
        return f"imported {arguments[0]}, which knows nothing of this race"
    return None


def _opened(path, mode, flags, roots) -> str | None:
    if not isinstance(path, (str, bytes)):
        return None
    path = os.path.abspath(os.fsdecode(path)) + ("/" if str(path).endswith("/") else "")
    writes = bool(flags & (os.O_WRONLY | os.O_RDWR)) or any(c in (mode or "") for c in "wax+")
    if writes and not path.startswith(("/tmp/", "/dev/null")):
        return f"wrote to {path}"
    if path.startswith(_HARMLESS) or path.startswith(roots) and "/models/tracks" not in path:
        return None
    return f"read {path}"


def _folder_of_airrace() -> str:
    return os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
