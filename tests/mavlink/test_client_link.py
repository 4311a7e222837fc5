"""On loopback, with free ports."""

import random
import socket

import pytest
from pymavlink.dialects.v20 import common as mavlink

from airrace.common.errors import UserError
from airrace.mavlink import client_link, telemetry
from airrace.mavlink.client_link import Addresses, ClientLink
from tests.worlds.mavlink_client import UdpClient, arm, rates


class Line:
    """A link and a client at its other end, which has heard a heartbeat."""

    def __init__(self, client):
        port, pictures = client.ports
        self.notes = []
        self.link = ClientLink(Addresses(port=port, picture_port=pictures), self.notes.append)
        self.client = client
        self.link.send(telemetry.heartbeat(False))
        client.hear()

    def deliver(self, *datagrams):
        """Sends datagrams from the client; returns the messages that were accepted."""
        for data in datagrams:
            self.client.send(data)
        return self.collect()

    def collect(self):
        while self.link.wait(0.05):
            self.link.drain()
        return self.link.take()


@pytest.fixture
def line():
    with UdpClient() as client:
        line = Line(client)
        yield line
        line.link.close()


def test_the_simulator_speaks_first_and_hears_on_the_same_socket(line):
    assert line.client.simulator == ("127.0.0.1", line.link.address[1])
    assert line.link.client is None
    (message,) = line.deliver(line.client.pack(rates(0.25)))
    assert message.get_type() == "SET_ATTITUDE_TARGET" and message.thrust == 0.25
    assert line.link.client == ("127.0.0.1", line.client.ports[0])
    assert line.notes == [f"Client at 127.0.0.1:{line.client.ports[0]}."]


def test_messages_may_share_a_datagram(line):
    first, second = line.client.pack(arm()), line.client.pack(rates(0.3))
    kinds = [message.get_type() for message in line.deliver(first + second)]
    assert kinds == ["COMMAND_LONG", "SET_ATTITUDE_TARGET"]


def test_pictures_go_to_their_own_port(line):
    line.link.send_picture(b"picture")
    assert line.client.pictures.recv(100) == b"picture"
    assert line.link.counts.picture_datagrams == 1


def test_replayed_messages_are_dropped(line):
    datagrams = [line.client.pack(rates(0.01 * i)) for i in range(10)]
    assert len(line.deliver(*datagrams)) == 10
    assert line.deliver(*datagrams) == [] and line.link.counts.replayed == 10
    # Numbers go on after 255.
    later = [line.client.pack(rates(0.3)) for _ in range(300)]
    assert len(line.deliver(*later)) == 300


def test_a_client_that_begins_anew_is_heard(line, monkeypatch):
    line.deliver(*[line.client.pack(rates(0.1)) for _ in range(100)])
    line.client.mavlink.seq = 0
    assert line.deliver(line.client.pack(rates(0.1))) == []
    now = client_link.time.monotonic()
    monkeypatch.setattr(client_link.time, "monotonic", lambda: now + 1.1)
    assert len(line.deliver(line.client.pack(rates(0.2)))) == 1


def test_oversized_datagrams_are_dropped(line):
    assert line.deliver(line.client.pack(rates(0.1)) + 60000 * b"x") == []
    assert line.link.counts.oversized == 1 and line.link.counts.malformed == 0
    assert len(line.deliver(line.client.pack(rates(0.1)))) == 1


def damaged(packed, rng):
    """Returns a datagram that is no good: cut off, changed, or noise."""
    kind = rng.randrange(4)
    if kind == 0:
        return packed[: rng.randrange(1, len(packed))]
    if kind == 1:
        i = rng.randrange(len(packed))
        return packed[:i] + bytes([packed[i] ^ (1 + rng.randrange(255))]) + packed[i + 1 :]
    if kind == 2:
        return rng.randbytes(rng.randrange(1, 400))
    return packed[:10] + rng.randbytes(50)


def test_malformed_datagrams_do_nothing_but_count(line):
    """Of every hundred, one is good, and comes through."""
    rng, good, bad = random.Random(4), 0, 0
    for _ in range(30):
        datagrams = [damaged(line.client.pack(rates(0.3)), rng) for _ in range(100)]
        line.client.mavlink.seq = good  # of the damaged ones, nobody knows
        datagrams[50] = line.client.pack(rates(0.1))
        good, bad = good + 1, bad + 99
        thrusts = [message.thrust for message in line.deliver(*datagrams)]
        assert thrusts == [pytest.approx(0.1)]
    counts = line.link.counts
    assert counts.received == good == 30
    # Where the damage is in its type, a message may be one that nobody knows.
    assert counts.malformed + counts.unknown == bad == 2970 and counts.unknown < 100
    assert counts.replayed == counts.strangers == counts.oversized == 0


def test_a_message_of_no_known_type_is_not_trusted(line):
    """There is no checksum to know it by: it neither flies nor says who the client is."""
    data = bytearray(line.client.pack(rates(0.9)))
    data[7:10] = b"\xff\xff\xff"
    assert line.deliver(bytes(data), b"") == [] and line.link.client is None
    assert (line.link.counts.unknown, line.link.counts.malformed) == (1, 1)


def test_a_second_client_is_refused_until_the_first_is_silent(line, monkeypatch):
    line.deliver(line.client.pack(rates(0.1)))
    with UdpClient() as other:
        other.simulator = line.client.simulator
        for _ in range(3):
            other.say(rates(0.9))
        assert line.collect() == [] and line.link.counts.strangers == 3
        name, first = (f"127.0.0.1:{each.ports[0]}" for each in (other, line.client))
        refusals = [note for note in line.notes if note.startswith("Refused")]
        assert refusals == [f"Refused {name}: {first} flies, and one client at a time."]
        # What is sent still goes to the first one.
        line.link.send(telemetry.heartbeat(True))
        assert line.client.hear() and other.hear(0.05) == []
        now = client_link.time.monotonic()
        monkeypatch.setattr(client_link.time, "monotonic", lambda: now + 2.1)
        other.say(rates(0.9))
        assert len(line.collect()) == 1 and line.link.client[1] == other.ports[0]


def test_a_client_that_is_not_there_is_no_error(line):
    line.client.socket.close()
    for _ in range(5):
        line.link.send(telemetry.heartbeat(False))
        line.link.drain()
    assert line.link.take() == []
    line.client.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)


def test_numbers_of_messages_go_up(line):
    for _ in range(300):
        line.link.send(telemetry.heartbeat(False))
    numbers = [message.get_seq() for _ in range(300) for message in line.client.hear(0.1)]
    assert numbers == [(1 + i) % 256 for i in range(300)]


@pytest.mark.parametrize(
    "addresses, words",
    [
        (Addresses(host="no.such.host.invalid"), "cannot be found"),
        (Addresses(bind="203.0.113.7"), "--bind 203.0.113.7 cannot be used"),
        (Addresses(bind="mine"), "--bind mine cannot be used"),
        (Addresses(host="198.51.100.2"), "is another computer: add --bind"),
    ],
)
def test_bad_addresses_are_refused_in_a_sentence(addresses, words):
    with pytest.raises(UserError, match=words) as e:
        ClientLink(addresses)
    assert "\n" not in str(e.value)


def test_nobody_else_than_this_computer_is_heard(line):
    assert line.link.address[0] == "127.0.0.1"


def test_it_takes_time_to_answer_a_flood_but_not_for_ever(line, monkeypatch):
    monkeypatch.setattr(client_link, "_MOST_AT_ONCE", 10)
    for _ in range(25):
        line.client.say(rates(0.1))
    for expected in (10, 10, 5):
        line.link.wait(1.0)
        line.link.drain()
        assert len(line.link.take()) == expected


def test_mavlink_1_is_understood(line):
    old = mavlink.MAVLink(None, srcSystem=255)
    data = rates(0.5).pack(old, force_mavlink1=True)
    assert data[0] == 0xFE
    assert len(line.deliver(data)) == 1
