"""On loopback, with free ports."""

import random
import socket

import pytest
from pymavlink.dialects.v20 import common as mavlink

from airrace.common.errors import UserError
from airrace.mavlink import client_link, telemetry
from airrace.mavlink.client_link import Addresses, ClientLink
from airrace.mavlink.dialects import DIALECTS
from tests.worlds.mavlink_client import UdpClient, arm, rates

HEARTBEAT = telemetry.heartbeat(DIALECTS["none"], armed=False)
# As a ground station sends it, and many a client.
STATION = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 0, 3)


class Line:
    """A link and a client at its other end, which has heard a heartbeat."""

    def __init__(self, client, **addresses):
        port, pictures = client.ports
        self.notes = []
        places = Addresses(port=port, picture_port=pictures, **addresses)
        self.link = ClientLink(places, self.notes.append)
        self.client = client
        self.link.send(HEARTBEAT)
        client.hear()

    def deliver(self, *datagrams):
        """Sends datagrams from the client; returns the messages that were accepted."""
        for data in datagrams:
            self.client.send(data)
        return self.collect()

    def collect(self):
        while self.link.wait(0.01):
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


def test_numbers_of_messages_are_not_looked_at(line):
    """Three threads that count alike, a counter that stands still, and one for each type."""
    datagrams = []
    for _ in range(100):
        for message in (arm(), rates(0.1), rates(0.2)):  # each thread begins at the same number
            line.client.mavlink.seq = len(datagrams) // 3 % 256
            datagrams.append(line.client.pack(message))
    for _ in range(50):
        line.client.mavlink.seq = 0
        datagrams.append(line.client.pack(rates(0.3)))
    heard = []
    for i in range(0, len(datagrams), 10):
        heard += line.deliver(*datagrams[i : i + 10])
    assert len(heard) == 350 and line.link.counts.received == 350
    assert sum(message.get_type() == "COMMAND_LONG" for message in heard) == 100
    assert line.link.counts.dropped == line.link.counts.malformed == 0


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


def test_malformed_datagrams_do_nothing_but_count(line, monkeypatch):
    """Of every hundred, one is good, and comes through."""
    monkeypatch.setattr(client_link, "_MANY", 1000)
    rng, good, bad = random.Random(4), 0, 0
    for _ in range(30):
        line.deliver(line.client.pack(STATION))  # what was cut off before ends here
        line.link.counts.received -= 1
        datagrams = [damaged(line.client.pack(rates(0.3)), rng) for _ in range(100)]
        line.client.mavlink.seq = good  # of the damaged ones, nobody knows
        datagrams[50] = line.client.pack(rates(0.1))
        good, bad = good + 1, bad + 99
        thrusts = [message.thrust for message in line.deliver(*datagrams)]
        assert thrusts == [pytest.approx(0.1)]
    counts = line.link.counts
    assert counts.received == good == 30
    # Where the damage is in its type, a message may be one that nobody knows; and a datagram may
    # end with what looks like the beginning of a message, which is another fault.
    assert 0.9 * bad < counts.malformed + counts.unknown < 1.2 * bad and bad == 2970
    assert counts.strangers == counts.oversized == counts.dropped == 0
    faults = [note for note in line.notes if "are not MAVLink, in whole or in part" in note]
    assert len(faults) == 1


def test_a_fragment_does_not_take_the_message_beside_it_away(line):
    whole = [line.client.pack(rates(0.01 * i)) for i in range(40)]
    heard = []
    for i in range(0, 40, 2):
        heard += line.deliver(whole[i] + whole[i + 1][:3], b"\0\0" + whole[i + 1])
    assert [round(100 * message.thrust) for message in heard] == list(range(40))


def test_a_stream_that_is_cut_at_fixed_sizes_is_put_together(line):
    whole = [line.client.pack(rates(0.01 * i)) for i in range(20)]
    stream = b"".join(whole)
    heard = []
    for i in range(0, len(stream), 20):
        heard += line.deliver(stream[i : i + 20])
    assert [round(100 * message.thrust) for message in heard] == list(range(20))
    assert line.link.counts.malformed == 0


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
        line.link.send(HEARTBEAT)
        assert line.client.hear() and other.hear(0.05) == []
        now = client_link.time.monotonic()
        monkeypatch.setattr(client_link.time, "monotonic", lambda: now + 2.1)
        other.say(rates(0.9))
        assert len(line.collect()) == 1 and line.link.client[1] == other.ports[0]


def test_a_client_that_spoke_while_nobody_listened_was_not_silent(line, monkeypatch):
    """A simulator that stood still for a while hears another one's command first."""
    line.deliver(line.client.pack(rates(0.1)))
    now = client_link.time.monotonic()
    monkeypatch.setattr(client_link.time, "monotonic", lambda: now + 2.1)
    with UdpClient() as other:
        other.simulator = line.client.simulator
        other.say(rates(0.9))
        line.client.say(rates(0.1))
        line.collect()
    assert line.link.client[1] == line.client.ports[0] and line.link.counts.strangers == 1


def test_a_ground_station_listens_and_does_not_fly(line):
    """Its heartbeat comes first; the client is who commands, and both are told all."""
    with UdpClient() as station:
        station.simulator = line.client.simulator
        station.say(STATION)
        line.collect()
        assert line.link.client is None and not line.link.heard
        line.client.say(STATION)  # a client may say that it is one
        line.collect()
        assert line.link.client is None and line.link.heard
        line.client.say(arm())
        assert len(line.collect()) == 1 and line.link.client[1] == line.client.ports[0]
        line.link.send(HEARTBEAT)
        assert line.client.hear() and station.hear()
        # It asks to control, while another one does.
        station.say(arm(0.0))
        assert line.collect() == [] and line.link.counts.strangers == 1


def test_a_ground_station_that_has_gone_is_told_nothing(line, monkeypatch):
    with UdpClient() as station:
        station.simulator = line.client.simulator
        station.say(STATION)
        line.collect()
        now = client_link.time.monotonic()
        monkeypatch.setattr(client_link.time, "monotonic", lambda: now + 5.1)
        line.link.drain()
        line.link.send(HEARTBEAT)
        assert station.hear(0.05) == []


def test_a_fixed_port_hears_all_wherever_commands_are_from():
    with UdpClient() as client, UdpClient() as commander:
        line = Line(client, fixed_port=True)
        commander.simulator = client.simulator
        commander.say(arm())
        assert len(line.collect()) == 1
        client.say(arm(), rates(0.1))  # both are ports of the client
        commander.say(rates(0.2))
        assert len(line.collect()) == 3 and line.link.counts.strangers == 0
        line.link.send(HEARTBEAT)
        assert client.hear() and commander.hear(0.05) == []
        line.link.close()


def test_ports_of_this_side_are_taken_if_they_are_free():
    with UdpClient() as client, UdpClient() as free:
        port, pictures = free.ports
        free.socket.close()
        line = Line(client, from_port=port, from_picture_port=pictures)  # the second is in use
        assert line.link.address == ("127.0.0.1", port) == client.simulator
        assert [note.split(":")[0] for note in line.notes] == [f"Port {pictures} is taken"]
        line.link.close()


def test_commands_for_other_vehicles_are_counted(line):
    for target in (0, 1, 7):
        message = rates(0.1)
        message.target_system = target
        line.client.say(message)
    assert len(line.collect()) == 3 and line.link.counts.elsewhere == 1


def test_of_a_flood_the_newest_is_taken(line):
    for i in range(200):
        line.client.say(rates(0.001 * i))
        if i == 5:
            line.client.say(arm())
    heard = line.collect()
    assert len(heard) < 60 and line.link.counts.dropped == 201 - len(heard)
    assert heard[-1].thrust == pytest.approx(0.199)
    assert any(message.get_type() == "COMMAND_LONG" for message in heard)


def test_a_client_that_is_not_there_is_no_error(line):
    line.client.socket.close()
    for _ in range(5):
        line.link.send(HEARTBEAT)
        line.link.drain()
    assert line.link.take() == []
    line.client.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)


def test_numbers_of_messages_go_up(line):
    for _ in range(300):
        line.link.send(HEARTBEAT)
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
