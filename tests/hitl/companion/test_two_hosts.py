"""The hosts of the other tests: what a bad cable does."""

import select
import socket
import time

import numpy as np

from tests.hitl.companion.bad_cable import in_namespace
from tests.hitl.companion.two_hosts import COMPANION

_PACKETS = 300


def _one_way(hosts):
    """Sends packets to the companion; returns the delays of those that come (ms)."""
    with in_namespace(hosts.companion):
        receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)  # stays there
    with receiver, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        receiver.bind((COMPANION, 0))
        receiver.settimeout(10.0)
        sender.sendto(b"", receiver.getsockname())  # finds the address
        receiver.recv(100)
        delays, sent = [], 0
        while select.select([receiver], [], [], 0.002 if sent < _PACKETS else 0.2)[0] or (
            sent < _PACKETS
        ):
            if select.select([receiver], [], [], 0.0)[0]:
                delays.append(time.monotonic() - float(receiver.recv(100)))
            if sent < _PACKETS:
                sender.sendto(repr(time.monotonic()).encode(), receiver.getsockname())
                sent += 1
    return 1e3 * np.array(delays)


def test_a_bad_cable(hosts):
    with hosts.bad_cable(delay=20, jitter=5, loss=5):
        delays = _one_way(hosts)
    assert 14.0 < np.percentile(delays, 1) < np.median(delays) < 30.0
    assert np.percentile(delays, 90) - np.percentile(delays, 10) > 4.0
    assert 0.85 < len(delays) / _PACKETS < 0.99
    # And the good one is back.
    delays = _one_way(hosts)
    assert len(delays) == _PACKETS and np.median(delays) < 5.0
