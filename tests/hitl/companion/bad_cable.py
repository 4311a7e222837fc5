"""A bad cable between two network namespaces, where the kernel has no netem.

    python bad_cable.py NAMESPACE NAMESPACE DEVICE DELAY_MS JITTER_MS LOSS_PERCENT

Both namespaces have a tap device of that name, whose frames are passed on: each after the
delay, give or take the jitter, and some not at all. As with netem, frames may overtake.
Prints a line when it is there.
"""

import contextlib
import fcntl
import heapq
import itertools
import os
import random
import select
import struct
import sys
import time

_TUNSETIFF, _IFF_TAP, _IFF_NO_PI = 0x400454CA, 0x0002, 0x1000
_LARGEST = 1 << 16  # bytes of a frame


@contextlib.contextmanager
def in_namespace(name: str):
    """Has this thread, and those that it starts, in a network namespace."""
    with open("/proc/thread-self/ns/net") as before, open(f"/run/netns/{name}") as there:
        os.setns(there.fileno(), os.CLONE_NEWNET)
        try:
            yield
        finally:
            os.setns(before.fileno(), os.CLONE_NEWNET)


def open_tap(namespace: str, device: str) -> int:
    """Returns a file descriptor of a tap device that a namespace has."""
    with in_namespace(namespace):
        tap = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
        fcntl.ioctl(tap, _TUNSETIFF, struct.pack("16sH", device.encode(), _IFF_TAP | _IFF_NO_PI))
    return tap


def relay(a: int, b: int, delay: float, jitter: float, loss: float) -> None:
    """Passes frames on for ever. Args: a, b: taps. delay, jitter: (s). loss: share."""
    other, waiting, number = {a: b, b: a}, [], itertools.count()
    rng = random.Random(0)
    while True:
        pause = max(waiting[0][0] - time.monotonic(), 0.0) if waiting else None
        for tap in select.select([a, b], [], [], pause)[0]:
            frame = os.read(tap, _LARGEST)
            if rng.random() >= loss:
                due = time.monotonic() + delay + rng.uniform(-jitter, jitter)
                heapq.heappush(waiting, (due, next(number), other[tap], frame))
        now = time.monotonic()
        while waiting and waiting[0][0] <= now:
            _, _, tap, frame = heapq.heappop(waiting)
            with contextlib.suppress(OSError):  # the other end is not up yet: it is lost
                os.write(tap, frame)


if __name__ == "__main__":
    taps = [open_tap(namespace, sys.argv[3]) for namespace in sys.argv[1:3]]
    print("here", flush=True)
    delay_ms, jitter_ms, loss_percent = map(float, sys.argv[4:])
    relay(*taps, delay_ms / 1e3, jitter_ms / 1e3, loss_percent / 100)
