"""The sockets between the simulator and one client."""

import contextlib
import dataclasses as dc
import select
import socket
import time
from collections.abc import Callable
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from airrace.common.errors import UserError, words

SYSTEM_ID, COMPONENT_ID = 1, 1
_LARGEST = 4096  # bytes of a datagram: all that follow each other in one are far less
_BUFFER = 4 * 1024 * 1024  # bytes, that wait in a socket
_PATIENCE = 2.0  # s without a word, after which another client may take over
_RESTART = 1.0  # s without a word, after which a client's numbers may begin anew
_MOST_AT_ONCE = 2000  # datagrams that are read in one go: a flood must not stop the time


class Addresses(NamedTuple):
    """Where the client is."""

    host: str = "127.0.0.1"  # of the client
    port: int = 14550  # at which it waits for MAVLink
    picture_port: int = 5600  # for pictures
    bind: str = "127.0.0.1"  # address of this computer that is used, 127.0.0.1 for nobody else


@dc.dataclass
class Counts:
    """Datagrams and messages so far."""

    sent: int = 0  # messages
    picture_datagrams: int = 0  # and datagrams of pictures
    received: int = 0  # messages that were good
    malformed: int = 0  # datagrams that are not MAVLink, in whole or in part
    oversized: int = 0  # datagrams that are too long
    # Messages of types that MAVLink's common set does not have, whose checksum nobody knows
    unknown: int = 0
    replayed: int = 0  # messages whose number is not after the one before
    refused: int = 0  # commands that cannot be obeyed
    strangers: int = 0  # datagrams of other clients than the first


class ClientLink:
    """Sends MAVLink and pictures to one client, and collects what it says.

    It sends first, to the address that it is given, and then to the one that answers. Until
    that has been silent for two seconds, nobody else is heard. Of what is no good, nothing
    happens but that it is counted.

    Attributes:
        counts: see Counts.
        client: address of the client that has answered, None before.
        messages: what came and was not taken yet, oldest first.
        note: shows a line.
    """

    def __init__(self, addresses: Addresses, note: Callable[[str], object] = print):
        """Opens the sockets; raises UserError if an address cannot be used."""
        self.counts, self.messages = Counts(), []
        self.note = note
        self._to, self._pictures_to = _resolved(addresses)
        try:
            self._socket = _udp(addresses.bind)
            self._pictures = _udp(addresses.bind)
        except OSError as e:
            raise UserError(
                f"--bind {addresses.bind} cannot be used ({words(e)}); give an address of this "
                "computer, such as 127.0.0.1 or 0.0.0.0."
            ) from None
        self._writer = mavlink.MAVLink(None, srcSystem=SYSTEM_ID, srcComponent=COMPONENT_ID)
        self._parser = mavlink.MAVLink(None)
        self.client: tuple | None = None
        self._heard_at = -1e9
        self._numbers: dict[tuple[int, int], int] = {}
        self._strangers: set[tuple] = set()

    @property
    def address(self) -> tuple:
        """Address of this side, to which clients send."""
        return self._socket.getsockname()

    def close(self) -> None:
        """Closes the sockets."""
        self._socket.close()
        self._pictures.close()

    def send(self, message: Any) -> None:
        """Sends a MAVLink message; what does not get through is lost, as always on UDP."""
        data = message.pack(self._writer)
        self._writer.seq = (self._writer.seq + 1) % 256
        with contextlib.suppress(OSError):
            self._socket.sendto(data, self.client or self._to)
            self.counts.sent += 1

    def send_picture(self, datagram: bytes) -> None:
        """Sends a datagram to the client's port of pictures."""
        with contextlib.suppress(OSError):
            self._pictures.sendto(datagram, self._pictures_to)
            self.counts.picture_datagrams += 1

    def wait(self, seconds: float) -> bool:
        """Waits until something has come; returns whether it has."""
        return bool(select.select([self._socket], [], [], seconds)[0])

    def drain(self) -> None:
        """Reads all that has come into ``messages``."""
        for _ in range(_MOST_AT_ONCE):
            try:
                data, sender = self._socket.recvfrom(_LARGEST + 1)
            except BlockingIOError:
                return
            except OSError:  # what an earlier datagram met, such as a port that is closed
                continue
            self._take(data, sender)

    def take(self) -> list:
        """Returns the messages that came, and forgets them."""
        taken, self.messages = self.messages, []
        return taken

    def _take(self, data, sender):
        is_free = self.client is None or time.monotonic() > self._heard_at + _PATIENCE
        if len(data) > _LARGEST:
            self.counts.oversized += 1
        elif sender != self.client and not is_free:
            self.counts.strangers += 1
            if sender not in self._strangers and len(self._strangers) < 100:
                self._strangers.add(sender)
                client = self.client or self._to
                self.note(
                    f"Refused {_named(sender)}: {_named(client)} flies, and one client at a time."
                )
        else:
            for message in self._parsed(data):
                self._accept(message, sender)

    def _parsed(self, data):
        """Returns the messages of a datagram, all of them or none."""
        try:
            found = self._parser.parse_buffer(data) or []
            if not found or self._parser.buf_len():
                raise mavlink.MAVError("the last message is not complete")
        except Exception:  # pymavlink raises errors of many kinds on bad bytes
            self.counts.malformed += 1
            self._parser = mavlink.MAVLink(None)
            return []
        known = [each for each in found if not isinstance(each, mavlink.MAVLink_unknown)]
        self.counts.unknown += len(found) - len(known)
        return known

    def _accept(self, message, sender):
        now = time.monotonic()
        source = message.get_srcSystem(), message.get_srcComponent()
        if sender != self.client or now > self._heard_at + _RESTART:
            if sender != self.client:
                self.note(f"Client at {_named(sender)}.")
            self.client, self._numbers = sender, {}
        number = message.get_seq()
        if source in self._numbers and not 0 < (number - self._numbers[source]) % 256 < 128:
            self.counts.replayed += 1
            return
        self._numbers[source], self._heard_at = number, now
        self.counts.received += 1
        self.messages.append(message)


def _resolved(addresses: Addresses) -> tuple[tuple, tuple]:
    """Returns where MAVLink and pictures go.

    Raises UserError if there is no such host, or it is another computer and --bind says nothing.
    """
    try:
        host = socket.gethostbyname(addresses.host)
    except OSError as e:
        raise UserError(
            f"--client {addresses.host} cannot be found ({words(e)}); give a host and a port, "
            "such as 127.0.0.1:14550."
        ) from None
    if not host.startswith("127.") and addresses.bind.startswith("127."):
        raise UserError(
            f"--client {addresses.host} is another computer: add --bind with the address of this "
            "one, at which it may be reached, and read about security in docs/grand_prix.md."
        )
    return (host, addresses.port), (host, addresses.picture_port)


def _udp(bind):
    """Returns a UDP socket that does not block."""
    udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        udp.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        udp.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER)
        udp.bind((bind, 0))
        udp.setblocking(False)
    except OSError:
        udp.close()
        raise
    return udp


def _named(address):
    return f"{address[0]}:{address[1]}"
