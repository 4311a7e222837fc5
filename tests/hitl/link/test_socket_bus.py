"""Messages over a pair of sockets: whole, in order, and never waited for."""

import socket
import struct
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.hitl.link import message_socket
from airrace.hitl.link.message_socket import LARGEST
from airrace.hitl.link.packets import MAX_SIZE
from airrace.hitl.link.socket_bus import SocketBus
from tests.worlds.cases import guarded
from tests.worlds.sockets import drain


def listener(end, *channels):
    """A bus, and the list of (channel, data) that it has received."""
    bus, received = SocketBus(end), []
    for channel in channels:
        bus.subscribe(channel, lambda *message: received.append(message))
    return bus, received


@given(
    messages=st.lists(
        st.tuples(st.sampled_from(["A", "BB", "Ä"]), st.binary(max_size=300)), max_size=20
    )
)
def test_messages_arrive_whole_and_in_order(messages):
    a, b = socket.socketpair()
    with a, b:
        sender, (bus, received) = SocketBus(a), listener(b, "A", "BB", "Ä")
        for channel, data in messages:
            sender.publish(channel, data)
        drain(bus)
        assert received == messages
        assert bus.received == sum(5 + len(c.encode()) + len(data) for c, data in messages)


def test_a_large_message_is_sent_while_the_other_side_reads(ends):
    sender, (bus, received) = SocketBus(ends[0]), listener(ends[1], "A")
    data = bytes(range(256)) * (MAX_SIZE // 256)
    sender.publish("A", data)  # more than the kernel takes at once, and does not block
    reader = threading.Thread(
        target=lambda: [bus.wait(5.0) or drain(bus) for _ in range(1000) if not received]
    )
    reader.start()
    while reader.is_alive():
        sender.wait(0.05)
    assert received == [("A", data)]


def test_what_nobody_reads_is_lost_beyond_a_limit(ends, monkeypatch):
    monkeypatch.setattr(message_socket, "MOST_WAITING", 1000)
    sender, (bus, received) = SocketBus(ends[0]), listener(ends[1], "A")
    for _ in range(3000):  # more than the kernel keeps
        sender.publish("A", bytes(900))
    for _ in range(4000):
        drain(bus)
        sender.wait(0.0)
    assert 0 < len(received) < 3000 and {len(data) for _, data in received} == {900}


def test_unsubscribed(ends):
    sender, bus = SocketBus(ends[0]), SocketBus(ends[1])
    received = []
    bus.unsubscribe(bus.subscribe("A", lambda *message: received.append(message)))
    sender.publish("A", b"x")
    drain(bus)
    assert received == []


def test_the_other_end_closes(ends):
    """What it sent before can still be read; then nothing comes, and sending does not raise."""
    sender, (bus, received) = SocketBus(ends[0]), listener(ends[1], "A")
    sender.publish("A", b"last words")
    sender.close()
    bus.publish("A", b"to nobody")
    drain(bus)
    assert received == [("A", b"last words")] and bus.is_broken
    bus.publish("A", b"to nobody")
    bus.wait(0.0)


@pytest.mark.parametrize(
    "head", [struct.pack(">I", 66) + 65 * b"A" + b"\0", struct.pack(">I", LARGEST + 1), b"\xff" * 6]
)
def test_what_is_no_message_breaks_the_link(ends, head):
    bus, received = listener(ends[1], "A")
    ends[0].sendall(struct.pack(">I", 3) + b"A\0x" + head + b"A")
    drain(bus)
    assert received == [("A", b"x")] and bus.is_broken
    assert not bus.hand_over()


@guarded
@given(data=st.binary(max_size=100))
def test_any_bytes(data):
    a, b = socket.socketpair()
    with a, b:
        bus = SocketBus(b)
        a.sendall(data)
        a.close()
        drain(bus)
        assert bus.received == len(data)
