"""The link over UDP: LCM's own tools on the other side, keys, and datagrams that are no messages."""

import contextlib
import os
import random
import socket
import time

import lcm
import pytest

from airrace.common.errors import UserError
from airrace.hitl.link import datagrams, packets, udp_bus
from airrace.hitl.link.endpoint import DEFAULT_URL, HEARTBEAT, Endpoint
from airrace.hitl.link.link_key import TRAILER, UNSIGNED
from airrace.hitl.link.udp_bus import UdpBus
from tests.hitl.link.messages import ROWS, message_of
from tests.worlds.mutations import mutated_bytes
from tests.worlds.network import CAN_UNSHARE, own_network

needs_network = pytest.mark.skipif(
    not CAN_UNSHARE, reason="a network of one's own (unshare -n) takes root"
)
KEY = bytes(range(32))
GROUP = "239.255.76.67", 7667
SIZES = (0, 1, 1000, 65_000, 65_499 - 2 - TRAILER, 65_499, 300_000, 1_000_000)
MAP = next(row for row in ROWS if row.ports == ("gate_map",))
CAMERA = next(row for row in ROWS if "camera_view" in row.ports)


@pytest.fixture
def network():
    with own_network():
        yield


@pytest.fixture
def opened(network):
    """Makes UdpBuses, which are closed in the end."""
    with contextlib.ExitStack() as stack:
        yield lambda *args: stack.enter_context(contextlib.closing(UdpBus(DEFAULT_URL, *args)))


@pytest.fixture
def raw(network):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        yield lambda datagram: sender.sendto(datagram, GROUP)


def heard_by(bus, channel="A", **limits):
    got = []
    bus.subscribe(channel, lambda _, data: got.append(data), **limits)
    return got


def drain(bus, timeout=0.2):
    end = time.monotonic() + timeout
    while time.monotonic() < end:
        while bus.hand_over():
            end = time.monotonic() + timeout
        bus.wait(0.01)


@needs_network
@pytest.mark.parametrize("key", [None, KEY], ids=["open", "key"])
def test_between_two_of_ours(opened, key):
    one, other = opened(key), opened(key)
    got = heard_by(other, max_size=packets.MAX_SIZE)
    sent = [os.urandom(size) for size in SIZES]
    for data in sent:
        one.publish("A", data)
        drain(other, 0.05)
    assert got == sent
    assert not other.summary()["dropped"]


@needs_network
@pytest.mark.parametrize("key", [None, KEY], ids=["open", "key"])
def test_tools_of_lcm_hear_us(opened, key):
    """With a key, what they hear ends with what we add to each datagram."""
    tool, got = lcm.LCM(DEFAULT_URL + "&recv_buf_size=4000000"), []
    tool.subscribe("A", lambda _, data: got.append(data))
    one, sent = opened(key), [os.urandom(size) for size in SIZES]
    for data in sent:
        one.publish("A", data)
        assert tool.handle_timeout(2000)
    end = -TRAILER if key else None
    assert [data[:end] for data in got] == sent


@needs_network
def test_we_hear_tools_of_lcm(opened):
    one = opened()
    got = heard_by(one, max_size=packets.MAX_SIZE)
    tool, sent = lcm.LCM(DEFAULT_URL), [os.urandom(size) for size in SIZES]
    for data in sent:
        tool.publish("A", data)
        drain(one, 0.05)
    assert got == sent


@needs_network
def test_who_has_no_key_or_another_one_is_not_heard(opened, raw):
    one, got = opened(KEY), []
    got = heard_by(one)
    for other in (opened(), opened(KEY[::-1])):
        other.publish("A", b"foreign")
    with_key = opened(KEY)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM):
        sealed = with_key._seal.sealed(next(datagrams.datagrams("A", b"true", 0)))
    for _ in range(3):
        raw(sealed)
    drain(one)
    assert got == [b"true"]
    assert one.summary()["dropped"] == {UNSIGNED: 2, packets.REPLAYED: 2}


@needs_network
def test_the_newest_messages_wait(opened):
    """Also while nobody asks for them: a thread takes them from the kernel's small buffer."""
    one = UdpBus(DEFAULT_URL + "&recv_buf_size=100000")
    with contextlib.closing(one):
        got, other = heard_by(one, most_waiting=8), opened()
        heard_by(one, "B")
        for k in range(50):
            other.publish("A", b"%d" % k + bytes(60_000))
            time.sleep(0.01)
        other.publish("B", b"")
        drain(one)
        assert [int(data[:2]) for data in got] == [*range(42, 50)]
        assert one.summary() == {"received": 51, "dropped": {udp_bus.OVERTAKEN: 42}}


@needs_network
def test_a_picture_that_is_larger_than_the_kernels_buffer(opened):
    """It gets through if somebody looks meanwhile; a busy machine may take some turns."""
    one = UdpBus(DEFAULT_URL + "&recv_buf_size=212992")
    with contextlib.closing(one):
        got, other = heard_by(one), opened()
        for _ in range(50):
            time.sleep(0.02)
            other.publish("A", bytes(921_600))
            drain(one, 0.02)
            if got:
                break
        assert got == [bytes(921_600)]


@needs_network
def test_what_the_kernel_drops_is_counted(opened):
    one = opened()
    heard_by(one, max_size=packets.MAX_SIZE)
    with one._lock:  # nobody can read
        for _ in range(20):
            opened().publish("A", bytes(1_000_000))
    assert one.summary()["dropped"][udp_bus.NO_ROOM] > 0


@needs_network
@pytest.mark.parametrize("key", [None, KEY], ids=["open", "key"])
def test_ten_thousand_mutated_datagrams(opened, raw, key):
    """Both sides are alive afterwards, and hear each other."""
    ends = [Endpoint(role, ROWS, opened(key)) for role in ("simulation", "autonomy")]
    sent = []
    for one in ends:
        bus = one._bus
        publish = bus._sender.sendto
        bus._sender = _Tapped(bus._sender, sent, publish)

    def exchange():
        for one in ends:
            one.send_heartbeat("waiting", 0.0)
            one.wait(0.01)
        for _ in range(2):
            for one in ends:
                one.drain()

    for _ in range(4):
        exchange()
    for row in ROWS:
        end = ends[row.sender == "autonomy"]
        end.publish(row.name, message_of(row), 0.1)
    exchange()
    assert {each.peer for each in ends} == {each.session for each in ends}
    true, rng = list(sent), random.Random(4)
    counts = [end.summary()["channels"] for end in ends]
    for k in range(10_000):
        datagram = mutated_bytes(rng, rng.choice(true))
        raw(datagram[:65_507])
        if k % 100 == 0:
            for one in ends:
                one.drain()
    for _ in range(3):
        exchange()
    for row in (MAP, CAMERA):
        end, other = ends[row.sender == "autonomy"], ends[row.sender != "autonomy"]
        before = other.statistics[row.name].received
        end.publish(row.name, message_of(row), 0.2)
        other.wait(0.1)
        other.drain()
        assert other.statistics[row.name].received == before + 1
    assert all(end.silence < 1.0 for end in ends) and counts
    for end in ends:
        dropped = end.summary()["datagrams"]["dropped"]
        assert dropped[UNSIGNED if key else packets.MALFORMED] > 1000
        assert end.statistics[HEARTBEAT].received < 100


class _Tapped:
    """A socket of which all that is sent is noted."""

    def __init__(self, sender, sent, publish):
        self._sender, self._sent, self._publish = sender, sent, publish

    def sendto(self, datagram, to):
        self._sent.append(datagram)
        self._publish(datagram, to)

    def close(self):
        self._sender.close()


@pytest.mark.parametrize(
    "url",
    [
        "nonsense",
        "memq://",
        "udpm://nonsense",
        "udpm://10.0.0.1:80?ttl=0",
        "udpm://239.255.76.67:0",
        "udpm://239.255.76.67:99999",
        "udpm://239.255.76.67:7667?ttl=256",
        "udpm://239.255.76.67:7667?ttl=x",
        "udpm://239.255.76.67:7667?tll=1",
        "udpm://239.255.76.67:7667?recv_buf_size=-1",
    ],
)
def test_a_url_that_cannot_be_opened(url):
    with pytest.raises(UserError, match="--lcm_url .* cannot be opened"):
        UdpBus(url)


@needs_network
def test_without_a_route(network):
    import subprocess

    subprocess.run(["ip", "route", "del", "224.0.0.0/4"], check=True)
    with pytest.raises(UserError, match="multicast route"):
        UdpBus(DEFAULT_URL)


def test_what_a_url_says():
    assert udp_bus._parsed("udpm://") == ("239.255.76.67", 7667, 0, 4 << 20)
    url = "udpm://239.1.2.3:1234?ttl=1&recv_buf_size=5000"
    assert udp_bus._parsed(url) == ("239.1.2.3", 1234, 1, 5000)
