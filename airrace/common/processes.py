"""This process among the others of this computer."""

import contextlib
import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path

_LOOK = 0.3  # s, between two looks at the parent
_FAREWELL = 5.0  # s, that it has to stop

# For an environment: where processes share the cores, the threads of their numerical
# libraries would only wait for one another.
ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "OPENCV_FOR_THREADS_NUM": "1",
}


_CGROUPS = Path("/sys/fs/cgroup")
_OWN_CGROUP = Path("/proc/self/cgroup")


def processors() -> int:
    """Returns how many processors this process may use, which may be fewer than there are.

    A batch system sets its affinity, sched_setaffinity(2); a container has a quota of time,
    cpu.max of cgroups(7), of which what is no whole processor does not count.
    """
    if hasattr(os, "sched_getaffinity"):  # on Linux
        number = len(os.sched_getaffinity(0))
    else:
        number = os.cpu_count() or 1
    return max(1, int(min([number, *_quotas()])))


def _quotas() -> Iterator[float]:
    """Yields the quotas of this process' cgroup, and of those above it, in processors."""
    try:
        lines = _OWN_CGROUP.read_text(encoding="utf-8").splitlines()
    except OSError:
        return
    for line in lines:
        number, _, path = line.split(":", 2)
        if number != "0":  # of version 1, whose quotas are elsewhere
            continue
        place = _CGROUPS / path.lstrip("/")
        for folder in (place, *place.parents):
            with contextlib.suppress(OSError, ValueError):  # the root has none, nor has "max"
                quota, period = (folder / "cpu.max").read_text(encoding="utf-8").split()
                yield int(quota) / int(period)


def stopped_with(parent: int) -> None:
    """Has this process told to stop, by SIGTERM, when its parent ends; see bound_to().

    It is told once more after a while: the second time it obeys, see interrupt_flag().
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_LOOK)
        for _ in range(2):
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(_FAREWELL)

    threading.Thread(target=watch, daemon=True).start()


def ending(code: int) -> str:
    """Returns what became of a process, from its exit code as subprocess has it, in words."""
    return f"was killed: {signal_name(-code)}" if code < 0 else f"ended with exit code {code}"


def signal_name(number: int) -> str:
    """Returns what a signal is called, such as ``SIGTERM``."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


@contextlib.contextmanager
def bound_to(parent: int) -> Iterator[None]:
    """Ends this process in the ``with`` block if its parent ends, which may have been killed.

    Args:
        parent: the number of the process that started this one, as that one knows it: it may have
            ended before.
    """
    over = threading.Event()

    def watch() -> None:
        while not over.wait(_LOOK):
            if os.getppid() != parent:
                os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    try:
        yield
    finally:
        over.set()


@contextlib.contextmanager
def real_time_priority() -> Iterator[bool]:
    """Lets all threads of this process run before any other process, if the user may do that.

    By Linux's first-in, first-out policy, sched(7): a thread that has something to do gets a
    processor at once, and keeps it. All threads, since one that waits for its turn may hold what
    the others wait for. Yields whether it could be had; `ulimit -r` says who may have it.
    """
    try:
        _schedule(os.SCHED_FIFO, 1)
    except (AttributeError, OSError):
        yield False
        return
    try:
        yield True
    finally:
        _schedule(os.SCHED_OTHER, 0)


def _schedule(policy: int, priority: int) -> None:
    for thread in os.listdir("/proc/self/task"):
        with contextlib.suppress(ProcessLookupError):  # it has just ended
            os.sched_setscheduler(int(thread), policy, os.sched_param(priority))
