"""A network of one's own for a test, where multicast goes over the loopback."""

import contextlib
import os
import subprocess

CAN_UNSHARE = (
    os.geteuid() == 0
    and subprocess.run(["unshare", "-n", "ip", "link"], capture_output=True, check=False).returncode
    == 0
)
UP = "ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo"


@contextlib.contextmanager
def own_network():
    """Sockets that this thread opens meanwhile are in a network that nobody else is in."""
    with open("/proc/thread-self/ns/net") as outside:
        os.unshare(os.CLONE_NEWNET)
        try:
            subprocess.run(["sh", "-c", UP], check=True)
            yield
        finally:
            os.setns(outside.fileno(), os.CLONE_NEWNET)
