"""What runs in the sandbox: python -m airrace.league.entry_process FD MEMORY THREADS FOLDER.

It flies the autonomy of an entry, in lockstep with the simulation at the other end of a socket.
FD is the socket's number, MEMORY how many GB the process may have (0: any), THREADS how many
threads, FOLDER holds the entry's scenario, its track's file, and the entry's own folder.

Nothing here keeps anybody from anything: the entry's code runs in this very process, and could
change whatever is written here. What holds is the sandbox.
"""

import contextlib
import os
import platform
import re
import resource
import shutil
import socket
import sys
import tempfile
import traceback
from pathlib import Path

import numba

from airrace.common.resources import PACKAGE, models_path
from airrace.league.attempts import Allowed, note_attempts
from airrace.league.sandbox import HIDDEN, MACHINE_CODE, OWN_MACHINE_CODE
from airrace.league.scenarios import ENTRY, SCENARIO

_MAX_FILE = 100e6  # bytes that any file may grow to
_MAX_OPEN = 256  # files and pipes, whose buffers are memory as well
# From here on Linux counts the threads of each user namespace by itself, not all of a user.
_COUNTS_OWN_THREADS = (5, 14)


def main(descriptor: int, memory: float, threads: int, folder: Path) -> int:
    """Flies; returns the exit code."""
    set_limits(memory, threads)
    own_tmp = memory > 0.0
    if own_tmp:
        shutil.copytree(
            MACHINE_CODE, OWN_MACHINE_CODE, copy_function=copy_if_there, dirs_exist_ok=True
        )
    os.chdir(folder)
    sys.path.insert(0, str(folder / ENTRY))
    try:
        with tempfile.TemporaryDirectory() as scratch:
            return fly(socket.socket(fileno=descriptor), Path(scratch), own_tmp)
    except BaseException as e:
        traceback.print_exc()
        print(f"airrace: {reason_of(e)}", flush=True)
        return 2


def copy_if_there(source: str, target: str) -> None:
    """Copies a file, unless it has gone: others may be compiling, which makes temporary files."""
    with contextlib.suppress(FileNotFoundError):
        shutil.copy2(source, target)


def set_limits(memory: float, threads: int) -> None:
    """Sets what this process, from now on, may use; memory: (GB), 0: any, outside of a sandbox."""
    limits = {resource.RLIMIT_CORE: 0}
    if memory:
        limits[resource.RLIMIT_AS] = int(memory * 1e9)
        limits[resource.RLIMIT_FSIZE] = int(_MAX_FILE)
        limits[resource.RLIMIT_NOFILE] = _MAX_OPEN
        if tuple(map(int, re.findall(r"\d+", platform.release())[:2])) >= _COUNTS_OWN_THREADS:
            limits[resource.RLIMIT_NPROC] = threads
    for limit, most in limits.items():
        resource.setrlimit(limit, (most, most))


def fly(end: socket.socket, scratch: Path, own_tmp: bool) -> int:
    """Builds the autonomy and races; returns the exit code.

    Args: scratch: a folder for what it writes. own_tmp: whether /tmp is this process' alone.
    """
    from airrace.diagrams.autonomy import MakeAutonomy
    from airrace.hitl.channels import make_channels
    from airrace.hitl.lcm_bridge import MakeLockstepSide, ports_wanted
    from airrace.hitl.link import phases
    from airrace.hitl.link.endpoint import AUTONOMY, Endpoint
    from airrace.hitl.link.lockstep import await_peer
    from airrace.hitl.link.partners import Partner
    from airrace.hitl.link.socket_bus import SocketBus
    from airrace.hitl.lockstep_autonomy import race_in_lockstep
    from airrace.scenario import load_scenario

    scenario = load_scenario(filename=SCENARIO)
    models, package = models_path(), PACKAGE
    allowed = Allowed(
        read=(str(Path.cwd()), str(package), str(models), MACHINE_CODE),
        write=("/tmp",) if own_tmp else (str(scratch), numba.config.CACHE_DIR),
        hidden=tuple(str(models / name) for name in HIDDEN),
    )
    note_attempts(allowed)  # from here on, code of the entry runs
    autonomy = MakeAutonomy(scenario)
    wanted = ports_wanted(autonomy)
    channels = make_channels(scenario, wanted)
    bus = SocketBus(end)
    endpoint = Endpoint(AUTONOMY, channels, bus, me=Partner(ports=tuple(wanted)))
    side = MakeLockstepSide(scenario, autonomy, channels, endpoint, scratch)
    await_peer(endpoint, phases.WAITING, expected=phases.READY, timeout=600.0)
    return race_in_lockstep(scenario, side, endpoint, stop=lambda: bus.is_broken)


def reason_of(error: BaseException) -> str:
    """Returns what went wrong, and where in the entry's own files, on one line."""
    message = " ".join(f"{type(error).__name__}: {error}".split())[:300]
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if f"/{ENTRY}/" in frame.filename]
    if not own or " at " in message:
        return message
    place = own[-1].filename.rpartition(f"/{ENTRY}/")[2]
    return f"{message}, at {place}:{own[-1].lineno}"


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4])))
