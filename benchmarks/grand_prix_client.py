"""A client of `airrace grand-prix` that takes off, hovers and listens.

    python benchmarks/grand_prix_client.py [--mavlink 14550] [--pictures 5600]

It waits for the simulator, answers every HIGHRES_IMU with exactly one command, and ends when it
has heard nothing for a while. It needs no airrace: only pymavlink, as other clients do.
"""

import argparse
import dataclasses as dc
import hashlib
import select
import socket
import struct
import sys
import time
from collections.abc import Callable

from pymavlink.dialects.v20 import common as mavlink

HEADER = struct.Struct("<IHHIIQ")  # frame, chunk, chunks, size of the JPEG, of the part, time (ns)
ARM, RESET = 400, 31000
_POSITION_ONLY = 0b110111111000  # type_mask of SET_POSITION_TARGET_LOCAL_NED
_HEIGHT = 2.0  # m, at which it hovers
_BUFFER = 4 * 1024 * 1024  # bytes that wait in a socket
_SILENCE = 5.0  # s, after which the simulator is taken to be gone


def command(number: int, param1: float = 0.0):
    """Returns COMMAND_LONG."""
    return mavlink.MAVLink_command_long_message(1, 1, number, 0, param1, *6 * [0.0])


def place(north: float, east: float, down: float):
    """Returns SET_POSITION_TARGET_LOCAL_NED for a place (m)."""
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, _POSITION_ONLY, north, east, down, *8 * [0.0]
    )


def hover(number: int) -> list:
    """Returns what answers the HIGHRES_IMU of a number: arming, then a place above the pad."""
    return [command(ARM, 1.0)] if number == 30 else [place(0.0, 0.0, -_HEIGHT)]


@dc.dataclass
class Times:
    """When messages of a kind came, in simulated time (s)."""

    count: int = 0
    first: float = 0.0
    last: float = 0.0

    def add(self, time: float) -> None:
        """Counts one that came at a time (s)."""
        self.first = self.first if self.count else time
        self.count, self.last = self.count + 1, time

    @property
    def rate(self) -> float:
        """Messages a second, NaN of fewer than two."""
        span = self.last - self.first
        return (self.count - 1) / span if span > 0.0 else float("nan")


@dc.dataclass
class Heard:
    """What has come.

    Attributes:
        messages: of MAVLink. kinds: of each kind, and of "pictures".
        gaps: messages that are missing between two numbers.
        datagrams: of pictures. pictures: that came whole.
        broken: pictures of which parts are missing. missing: pictures of which nothing came.
        sent: commands and other messages that were sent.
        time: of the last HIGHRES_IMU (s).
    """

    messages: int = 0
    kinds: dict = dc.field(default_factory=dict)
    gaps: int = 0
    datagrams: int = 0
    pictures: int = 0
    broken: int = 0
    missing: int = 0
    sent: int = 0
    time: float = 0.0

    def add(self, kind: str, time: float) -> None:
        """Counts a message of a kind."""
        self.kinds.setdefault(kind, Times()).add(time)


class Client:
    """Hears a simulator, and answers every HIGHRES_IMU.

    Attributes:
        heard: see Heard. ports: of MAVLink and of pictures.
        hashes: of the messages and of the pictures that were heard until ``hash_until`` (s,
            simulated), without numbers of messages and answers. There are two because
            nobody knows which of two sockets was first.
    """

    def __init__(
        self,
        ports: tuple[int, int] = (0, 0),
        answer: Callable[[int], list] = hover,
        hash_until: float = 0.0,
    ):
        """Waits at two ports of loopback, 0 for free ones; answer: number to messages."""
        self._mavlink, self._pictures = map(_bound, ports)
        self.ports = tuple(s.getsockname()[1] for s in (self._mavlink, self._pictures))
        self.heard, self.hashes = Heard(), (hashlib.sha256(), hashlib.sha256())
        self.simulator = self.picture_source = None  # addresses
        self._answer, self._hash_until, self._answered = answer, hash_until, 0
        self._writer = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self._parser = mavlink.MAVLink(None)
        self._number = self._frame = None
        self._parts = self._total = 0

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self._mavlink.close()
        self._pictures.close()

    def listen(self, seconds: float) -> bool:
        """Hears all that comes within a time (s), at least once; returns whether anything has."""
        ready = select.select([self._mavlink, self._pictures], [], [], seconds)[0]
        if self._pictures in ready:  # before the message of the IMU that comes after it
            for data, source in _datagrams(self._pictures):
                self._see(data, source)
        if self._mavlink in ready:
            for data, source in _datagrams(self._mavlink):
                self._hear(data, source)
        return bool(ready)

    def pack(self, message) -> bytes:
        """Returns a message with the next number."""
        data = message.pack(self._writer)
        self._writer.seq = (self._writer.seq + 1) % 256
        self.heard.sent += 1
        return data

    def send(self, data: bytes) -> None:
        """Sends a datagram to the simulator."""
        self._mavlink.sendto(data, self.simulator)

    def reply(self, number: int) -> None:
        """Answers the HIGHRES_IMU of a number."""
        for message in self._answer(number):
            self.send(self.pack(message))

    def _hear(self, data, source):
        if source != self.simulator:
            self.simulator = source
            beat = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 0, 3)
            self.send(self.pack(beat))
        for message in self._parser.parse_buffer(data) or []:
            heard, kind = self.heard, message.get_type()
            heard.messages += 1
            number = message.get_seq()
            if self._number is not None:
                heard.gaps += (number - self._number - 1) % 256
            self._number = number
            is_imu = kind == "HIGHRES_IMU"
            if is_imu:
                heard.time = message.time_usec / 1e6
            if kind == "ENCAPSULATED_DATA":
                kind = f"{kind} type {message.data[0]}"
                if message.data[0] == 2 and message.seqnr > 0:
                    kind = "ENCAPSULATED_DATA, the track's rest"
            if heard.time > 0.0:  # before, time stands still
                heard.add(kind, heard.time)
            if heard.time <= self._hash_until and kind not in ("COMMAND_ACK", "STATUSTEXT"):
                self.hashes[0].update(kind.encode() + message.get_payload())
            if is_imu:
                self._answered += 1
                self.reply(self._answered)

    def _see(self, data, source):
        self.picture_source = source
        frame, chunk, total, _, _, time_ns = HEADER.unpack_from(data)
        heard = self.heard
        heard.datagrams += 1
        if frame != self._frame:
            self._end_picture()
            if self._frame is not None:
                heard.missing += (frame - self._frame - 1) % 2**32
            heard.add("pictures", time_ns / 1e9)
            self._frame, self._parts, self._total = frame, 0, total
        self._parts += 1
        if time_ns / 1e9 <= self._hash_until:
            self.hashes[1].update(data)

    def _end_picture(self):
        if self._frame is not None:
            self.heard.pictures += self._parts == self._total
            self.heard.broken += self._parts != self._total

    def end(self) -> Heard:
        """Returns what has come until now, with the last picture."""
        self._end_picture()
        self._frame = None
        return self.heard


def _bound(port):
    udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    udp.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
    udp.bind(("127.0.0.1", port))
    udp.setblocking(False)
    return udp


def _datagrams(udp):
    """Yields what waits in a socket."""
    while True:
        try:
            yield udp.recvfrom(65536)
        except BlockingIOError:
            return
        except ConnectionError:  # what was sent before has met a closed port
            continue


def main() -> int:
    """Hovers until the simulator is gone."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--mavlink", type=int, default=14550, help="port (default: 14550)")
    parser.add_argument("--pictures", type=int, default=5600, help="port (default: 5600)")
    args = parser.parse_args()
    with Client((args.mavlink, args.pictures)) as client:
        heard_at = time.monotonic()
        while client.simulator is None or time.monotonic() < heard_at + _SILENCE:
            if client.listen(0.5):
                heard_at = time.monotonic()
        heard = client.end()
    print(f"heard {heard.messages} messages, {heard.pictures} pictures, {heard.time:.1f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
