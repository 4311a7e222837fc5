"""The kinds of messages that others send: what is sound, and what receives it.

A file holds what arrives at once, as in untrusted_files.py. Afterwards a sound message must still
get through: that it does not is a wrong result.
"""

import contextlib
import functools
import http.client
import socket
import struct
import zlib
from pathlib import Path
from random import Random

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from airrace.hitl.link import message_socket
from airrace.hitl.link.datagrams import Assembler, datagrams
from airrace.hitl.link.endpoint import Endpoint
from airrace.hitl.link.simulated_bus import LinkConfig, SimulatedLink
from airrace.hitl.link.socket_bus import SocketBus
from airrace.mavlink.client_link import Addresses, ClientLink
from airrace.mavlink.commands import SETPOINTS, RefusedError, Situation, make_airframe, setpoint_of
from airrace.mavlink.dialects import DIALECTS
from airrace.systems.control.setpoint import NO_SETPOINT
from airrace.vehicle import load_vehicle
from airrace.visualization.controls import PaceRequest
from airrace.visualization.page_server import PageServer, Source
from airrace.visualization.race_record import RaceRecord
from tests.hitl.link.messages import ROWS, message_of
from tests.worlds.mavlink_client import UdpClient, attitude, motors, rates, velocity
from tests.worlds.mutations import mutated_bytes
from tests.worlds.sockets import drain
from tests.worlds.untrusted_kind import Kind, WrongResult

_MAP = next(row for row in ROWS if row.ports == ("gate_map",))
_AT_CRC, _AT_SESSION = 8, 16  # in a message over LCM, see packets.py
_NUMBERS = (0.0, 1.0, -1.0, 1e-30, 3e38, float("nan"), float("inf"), float("-inf"))


class _Link:
    """Both ends of a link in one process, which have heard each other."""

    def __init__(self):
        self.air, self.assembler = SimulatedLink(LinkConfig()), Assembler()
        self.assembler.limits[_MAP.name] = _MAP.max_size
        self.simulation, self.autonomy = (
            Endpoint(role, ROWS, self.air.bus(), clock=self.air.clock)
            for role in ("simulation", "autonomy")
        )
        for _ in range(4):
            for one in (self.simulation, self.autonomy):
                self.air.time += 0.05
                one.send_heartbeat("waiting", 0.0)
                self.simulation.drain()
                self.autonomy.drain()

    def publish(self) -> bytes:
        self.air.time += 0.01
        return self.autonomy.publish(_MAP.name, message_of(_MAP), 0.0)


_link = functools.cache(_Link)


def _datagram(data: bytes) -> bytes:
    """Returns the first datagram of a message."""
    return next(datagrams(_MAP.name, data, 1))


def _make_lcm(folder: Path) -> Path:
    (folder / "datagram").write_bytes(_datagram(_link().publish()))
    return folder / "datagram"


def _mutated_lcm(rng: Random, datagram: bytes) -> bytes:
    """Returns other bytes, often with a checksum that is right: then somebody means it."""
    if rng.random() < 0.3:
        return mutated_bytes(rng, datagram)
    data = mutated_bytes(rng, datagram[len(_datagram(b"")) :])
    return _datagram(data if rng.random() < 0.2 else _with_checksum(data))


def _with_checksum(data: bytes) -> bytes:
    crc = struct.pack(">I", zlib.crc32(data[_AT_CRC + 4 :]))
    return data[:_AT_CRC] + crc + data[_AT_CRC + 4 :]


def _receive_lcm(path: Path) -> None:
    link = _link()
    message = link.assembler.take(memoryview(path.read_bytes()), "others")
    if link.assembler.take(memoryview(_datagram(b"sound")), "others") is None:
        raise WrongResult("no datagram is taken any more")
    _, data = message or ("", b"")
    if data == _with_checksum(data):  # whoever means it also knows the session and the next number
        whose = struct.pack(">qq", link.autonomy.session, link.autonomy.sequence(_MAP.name) + 1)
        data = _with_checksum(data[:_AT_SESSION] + whose + data[_AT_SESSION + len(whose) :])
    link.air.send(_MAP.name, data)
    link.simulation.drain()
    link.publish()  # it may have the number of the one before
    link.publish()
    link.simulation.drain()
    received = link.simulation.newest(_MAP.name)
    if received is None or received.stamp.sequence != link.autonomy.sequence(_MAP.name):
        raise WrongResult("a sound message does not get through any more")


class _Client:
    """A client of the Grand Prix on loopback, and the simulator's end."""

    def __init__(self):
        self.client = UdpClient().__enter__()  # for as long as the process lives
        port, pictures = self.client.ports
        self.link = ClientLink(Addresses(port=port, picture_port=pictures), lambda note: None)
        self.link.send(mavlink.MAVLink_heartbeat_message(0, 0, 0, 0, 0, 3))
        self.client.hear()

    def collect(self) -> list:
        while self.link.wait(0.01):
            self.link.drain()
        return self.link.take()


_client = functools.cache(_Client)


def _make_mavlink(folder: Path) -> Path:
    (folder / "datagram").write_bytes(_client().client.pack(rates(0.25)))
    return folder / "datagram"


def _mutated_mavlink(rng: Random, data: bytes) -> bytes:
    """Returns other bytes, or a sound message that asks for anything."""
    if rng.random() < 0.5:
        return mutated_bytes(rng, data)[:5000]
    numbers, mask = (lambda n: [rng.choice(_NUMBERS) for _ in range(n)]), rng.randrange(1 << 16)
    message = rng.choice(
        (
            lambda: rates(*numbers(4), mask=mask & 255, q=numbers(4)),
            lambda: attitude(numbers(4), *numbers(1)),
            lambda: velocity(*numbers(5), mask=mask, place=numbers(3)),
            lambda: motors(*numbers(8)),
        )
    )
    return _client().client.pack(message())


def _receive_mavlink(path: Path) -> None:
    end = _client()
    end.client.send(path.read_bytes())
    for message in end.collect():
        if message.get_type() in SETPOINTS:
            with contextlib.suppress(RefusedError):
                for dialect in DIALECTS.values():
                    frame = make_airframe(load_vehicle("vadr")[0], dialect)
                    situation = Situation(frame, np.zeros(3), np.ones(3), 0.5, NO_SETPOINT)
                    setpoint = setpoint_of(message, dialect, situation)
                    if not all(np.isfinite(part).all() for part in setpoint):
                        raise WrongResult("it is obeyed, and not finite")
    end.client.send(end.client.pack(rates(0.5)))
    if not end.collect():
        raise WrongResult("a sound message does not get through any more")


@functools.cache
def _page() -> PageServer:
    return PageServer(Source(str, "127.0.0.1:9", RaceRecord(), PaceRequest()))


_PAGE_SAYS = (
    b"GET /race HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    b"\x81\x8f\0\0\0\0"  # a frame of text, 15 bytes
    b'{"pause": true}'
)


def _make_page(folder: Path) -> Path:
    (folder / "request").write_bytes(_PAGE_SAYS)
    return folder / "request"


def _receive_page(path: Path) -> None:
    port = int(_page().url.rpartition(":")[2])
    with socket.create_connection(("127.0.0.1", port), timeout=5.0) as browser:
        with contextlib.suppress(OSError):  # it may have been closed meanwhile
            browser.sendall(path.read_bytes())
    asking = http.client.HTTPConnection("127.0.0.1", port, timeout=5.0)
    asking.request("GET", "/", headers={"Host": "localhost"})
    if asking.getresponse().status >= 500:
        raise WrongResult("the page is served no more")
    asking.close()


def _make_stream(folder: Path) -> Path:
    """What an entry of a league sends: messages one after the other."""
    a, b = socket.socketpair()
    with a, b:
        sender = SocketBus(a)
        for size in (0, 10, 1000):
            sender.publish("CHANNEL", bytes(size))
        (folder / "stream").write_bytes(b.recv(10_000))
    return folder / "stream"


def _receive_stream(path: Path) -> None:
    a, b = socket.socketpair()
    with a, b:
        bus, taken = SocketBus(b), []
        bus.subscribe("CHANNEL", lambda channel, data: taken.append(data))
        a.sendall(path.read_bytes())
        a.close()
        drain(bus)
    if any(len(data) > message_socket.LARGEST for data in taken):
        raise WrongResult("a message is larger than any may be")


MESSAGES = (
    Kind("datagram over LCM", _make_lcm, _mutated_lcm, _receive_lcm),
    Kind("datagram of MAVLink", _make_mavlink, _mutated_mavlink, _receive_mavlink),
    Kind("what a browser sends", _make_page, mutated_bytes, _receive_page),
    Kind("what an entry sends", _make_stream, mutated_bytes, _receive_stream),
)
