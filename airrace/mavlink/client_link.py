"""The sockets between the simulator and one client."""

import collections
import contextlib
import dataclasses as dc
import errno
import select
import socket
import time
from collections.abc import Callable
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from airrace.common.errors import UserError, words
from airrace.mavlink.commands import ARM, RESET, SET_MODE, SETPOINTS
from airrace.mavlink.splitter import LARGEST, Splitter

SYSTEM_ID, COMPONENT_ID = 1, 1
_BUFFER = 4 * 1024 * 1024  # bytes, that wait in a socket
_PATIENCE = 2.0  # s without a word, after which another client may take over
_LISTENERS, _LISTENING = 4, 5.0  # ground stations at a time, and s after the last word of one
_MOST_AT_ONCE = 2000  # datagrams that are read in one go: a flood must not stop the time
_MANY = 32  # datagrams at once, which come after a pause of a client that sends 250 a second; of
_MOST_OF_A_KIND = 16  # more, so many of each type are taken, the newest
_MOST_STRANGERS = 100  # who are named on the terminal


class Addresses(NamedTuple):
    """Where the client is, and which ports of this side it knows."""

    host: str = "127.0.0.1"  # of the client
    port: int = 14550  # at which it waits for MAVLink
    picture_port: int = 5600  # for pictures
    bind: str = "127.0.0.1"  # address of this computer that is used, 127.0.0.1 for nobody else
    from_port: int = 0  # that MAVLink is sent from, 0 for any
    from_picture_port: int = 0  # that pictures are sent from, 0 for any
    # Whether MAVLink goes to `port` wherever the client's words are from; then all ports of its
    # computer are its own.
    fixed_port: bool = False


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
    dropped: int = 0  # messages of which too many came at once
    refused: int = 0  # commands that cannot be obeyed
    elsewhere: int = 0  # commands for other vehicles
    strangers: int = 0  # datagrams of other clients than the first


class ClientLink:
    """Sends MAVLink and pictures to one client, and collects what it says.

    It sends first, to the address that it is given. The first one that commands something is the
    client; until it has been silent for two seconds, nobody else may command. Others may listen: a
    ground station that sends heartbeats is told all that the client is. Numbers of messages are
    not looked at: a client may send from several threads that count alike. Of what is no good,
    nothing happens but that it is counted.

    Attributes:
        counts: see Counts.
        client: address of the client that commands, None before.
        heard: whether the client, or whoever is where it is expected, has said anything.
        messages: what came and was not taken yet, oldest first.
        note: shows a line.
        time: simulated (s), as of the last listening.
        tap: is called with each message of both sides: the time (s), whether it was sent, and its
            bytes.
    """

    def __init__(self, addresses: Addresses, note: Callable[[str], object] = print):
        """Opens the sockets; raises UserError if an address cannot be used."""
        self.counts, self.messages = Counts(), []
        self.note, self.tap, self.time = note, _no_tap, 0.0
        self._to, self._pictures_to = _resolved(addresses)
        self._fixed = addresses.fixed_port
        try:
            self._socket = _udp(addresses.bind, addresses.from_port, note)
            self._pictures = _udp(addresses.bind, addresses.from_picture_port, note)
        except OSError as e:
            raise UserError(
                f"--bind {addresses.bind} cannot be used ({words(e)}); give an address of this "
                "computer, such as 127.0.0.1 or 0.0.0.0."
            ) from None
        self._writer = mavlink.MAVLink(None, srcSystem=SYSTEM_ID, srcComponent=COMPONENT_ID)
        self._splitters: dict[tuple, Splitter] = {}
        self.client: tuple | None = None
        self.heard = False
        self._heard_at = -1e9
        self._listeners: dict[tuple, float] = {}
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
        self.tap(self.time, True, data)
        to = self._to if self._fixed or self.client is None else self.client
        with contextlib.suppress(OSError):
            self._socket.sendto(data, to)
            self.counts.sent += 1
        for listener in self._listeners:
            with contextlib.suppress(OSError):
                self._socket.sendto(data, listener)

    def send_picture(self, datagram: bytes) -> None:
        """Sends a datagram to the client's port of pictures."""
        with contextlib.suppress(OSError):
            self._pictures.sendto(datagram, self._pictures_to)
            self.counts.picture_datagrams += 1

    def wait(self, seconds: float) -> bool:
        """Waits until something has come; returns whether it has."""
        return bool(select.select([self._socket], [], [], seconds)[0])

    def drain(self) -> None:
        """Reads all that has come into ``messages``; of a flood, only what is newest."""
        came = []
        for _ in range(_MOST_AT_ONCE):
            try:
                came.append(self._socket.recvfrom(LARGEST + 1))
            except BlockingIOError:
                break
            except OSError:  # what an earlier datagram met, such as a port that is closed
                continue
        now = time.monotonic()
        # A client that spoke while this side did not listen was not silent.
        if any(self._is_client(sender) for _, sender in came):
            self._heard_at = now
        self._listeners = {a: at for a, at in self._listeners.items() if now < at + _LISTENING}
        for data, sender in self._newest(came):
            self._take(data, sender, now)

    def take(self) -> list:
        """Returns the messages that came, and forgets them."""
        taken, self.messages = self.messages, []
        return taken

    def _newest(self, came):
        """Returns the datagrams without those of which too many of a kind have come."""
        if len(came) <= _MANY:
            return came
        left, kept = collections.Counter[tuple](), []
        for data, sender in reversed(came):
            kind = sender, data[7:10]  # where MAVLink 2 has its type
            left[kind] += 1
            if left[kind] <= _MOST_OF_A_KIND:
                kept.append((data, sender))
        self.counts.dropped += len(came) - len(kept)
        return kept[::-1]

    def _take(self, data, sender, now):
        if len(data) > LARGEST:
            self.counts.oversized += 1
            return
        if sender not in self._splitters and len(self._splitters) >= _MOST_STRANGERS:
            self._splitters.clear()
        splitter = self._splitters.setdefault(sender, Splitter())
        messages, faults = splitter.split(data)
        known = [each for each in messages if not isinstance(each, mavlink.MAVLink_unknown)]
        self.counts.unknown += len(messages) - len(known)
        if faults:
            self.counts.malformed += faults
            if splitter.is_first_fault():
                self.note(f"Datagrams of {_named(sender)} are not MAVLink, in whole or in part.")
        if known and self._may_speak(known, sender, now):
            for message in known:
                self.tap(self.time, False, bytes(message.get_msgbuf()))
            self.counts.received += len(known)
            self.counts.elsewhere += sum(not is_for_us(message) for message in known)
            self.messages += known

    def _may_speak(self, messages, sender, now):
        """Returns whether a sender is heard; one that commands becomes the client if none is."""
        is_free = self.client is None or now > self._heard_at + _PATIENCE
        commands = any(controls(message) for message in messages)
        if commands and not self._is_client(sender):
            if not is_free:
                self._refuse(sender)
                return False
            self.client, self._heard_at = sender, now
            self._listeners.pop(sender, None)
            self.note(f"Client at {_named(sender)}.")
        elif self._is_a_station(messages, sender):
            if sender in self._listeners or len(self._listeners) < _LISTENERS:
                self._listeners[sender] = now
        self.heard = self.heard or sender in (self._to, self.client)
        return True

    def _is_a_station(self, messages, sender):
        """Whether a sender is one who only listens, and says that it is there."""
        is_other = sender != self._to and not self._is_client(sender)
        return is_other and any(message.get_type() == "HEARTBEAT" for message in messages)

    def _is_client(self, sender):
        """Whether a sender is the client, which may have several ports if one is told all."""
        if self.client is None:
            return False
        return sender == self.client or (self._fixed and sender[0] == self.client[0])

    def _refuse(self, sender):
        self.counts.strangers += 1
        if sender not in self._strangers and len(self._strangers) < _MOST_STRANGERS:
            self._strangers.add(sender)
            self.note(
                f"Refused {_named(sender)}: {_named(self.client)} flies, and one client at a time."
            )


def is_for_us(message: Any) -> bool:
    """Returns whether a message is for this vehicle, or for all."""
    return getattr(message, "target_system", SYSTEM_ID) in (0, SYSTEM_ID)


def controls(message: Any, orders: tuple[int, ...] = (ARM, RESET, SET_MODE)) -> bool:
    """Returns whether a message asks to control this vehicle, and does not only listen.

    Args: orders: commands that count, beside set-points.
    """
    kind = message.get_type()
    is_order = kind == "COMMAND_LONG" and message.command in orders
    return (kind in SETPOINTS or is_order) and is_for_us(message)


def _no_tap(time: float, sent: bool, data: bytes) -> None:
    """What is said on a link that nobody records."""


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


def _udp(bind, port, note):
    """Returns a UDP socket that does not block, at a port, or if that is taken, at any."""
    udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        udp.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        udp.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER)
        try:
            udp.bind((bind, port))
        except OSError as e:
            if e.errno != errno.EADDRINUSE:
                raise
            udp.bind((bind, 0))
            note(f"Port {port} is taken: port {udp.getsockname()[1]} is used in its place.")
        udp.setblocking(False)
    except OSError:
        udp.close()
        raise
    return udp


def _named(address):
    return f"{address[0]}:{address[1]}"
