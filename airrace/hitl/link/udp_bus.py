"""The link over UDP multicast, as LCM has it, with a receiver that nothing it hears can end."""

import collections
import contextlib
import ipaddress
import itertools
import math
import select
import socket
import struct
import threading
import time
import urllib.parse
from collections.abc import Callable
from typing import Any, NamedTuple

from airrace.common.errors import UserError
from airrace.hitl.link.bus import Bus, Subscription
from airrace.hitl.link.datagrams import LARGEST, Assembler, datagrams
from airrace.hitl.link.link_key import TRAILER, Seal
from airrace.hitl.link.packets import Dropped

OVERTAKEN = "too many waited"
NO_ROOM = "no room in the kernel's buffer"
_GROUP, _PORT = "239.255.76.67", 7667  # LCM's own
_BUFFER = 4 << 20  # bytes; the usual 208 KiB lose most of the larger pictures
# As many datagrams as fit into the usual 208 KiB, after which who reads may catch up: for a whole
# picture that is not compressed, as in lockstep.
_BURST, _PAUSE = 4, 0.001  # datagrams, s
_AT_ONCE = 256  # datagrams, after which others have a turn
_ABSENT = 0.005  # s without a look at what has come, after which somebody else looks
_MEMORY, _DROPS, _NUMBERS = 55, 8, struct.Struct("9I")  # Linux: SO_MEMINFO, and what is in it


class _Address(NamedTuple):
    group: str
    port: int
    ttl: int
    buffer: int  # of the kernel, for what arrives (bytes)


def _parsed(url: str) -> _Address:
    """Returns what a URL of LCM says; raises ValueError if it is none for UDP multicast."""
    parts = urllib.parse.urlsplit(url)
    group = ipaddress.IPv4Address(parts.hostname or _GROUP)
    options = dict(urllib.parse.parse_qsl(parts.query, strict_parsing=bool(parts.query)))
    ttl, buffer = int(options.pop("ttl", 0)), int(options.pop("recv_buf_size", _BUFFER))
    port = _PORT if parts.port is None else parts.port
    is_sound = 0 <= ttl < 256 and 0 < buffer < 1 << 31 and 0 < port
    if parts.scheme != "udpm" or not group.is_multicast or options or not is_sound:
        raise ValueError
    return _Address(str(group), port, ttl, buffer)


class UdpBus(Bus):
    """Sends and receives messages of LCM.

    It reads when it is asked for a message. While nobody asks, since the process computes, a thread
    reads: the kernel's buffer is full after a few pictures. Of each channel the newest messages
    wait, a bounded number.
    """

    def __init__(self, url: str, key: bytes | None = None):
        """Opens it.

        Args:
            url: ``udpm://GROUP:PORT?ttl=N``, as LCM has it; recv_buf_size may be among the options.
            key: from read_key(), to sign what is sent, and hear nothing else; None: without.

        Raises UserError if it cannot be opened.
        """
        super().__init__()
        try:
            address = _parsed(url)
            self._sender, self._receiver = _sockets(address)
        except (OSError, ValueError):
            raise UserError(
                f"--lcm_url {url} cannot be opened: it must be like "
                "udpm://239.255.76.67:7667?ttl=0, and there must be a multicast route "
                "(ip route add 224.0.0.0/4 dev INTERFACE)."
            ) from None
        self._to = address.group, address.port
        self._seal = None if key is None else Seal(key)
        self._trailer = TRAILER if self._seal else 0
        self._assembler = Assembler(self._trailer)
        self._queues: dict[str, collections.deque[tuple[int, bytes]]] = {}  # order and message
        self._order, self._numbers = itertools.count(), itertools.count()
        self._buffer = memoryview(bytearray(LARGEST))
        self._datagrams, self._asked = 0, time.monotonic()
        self._lock, self._closed = threading.Lock(), threading.Event()
        threading.Thread(target=self._stand_in, daemon=True).start()

    def close(self) -> None:
        """Sends and receives nothing any more."""
        self._closed.set()
        with self._lock:
            self._sender.close()
            self._receiver.close()

    def fileno(self) -> int:
        """Returns the receiving socket's, for select()."""
        return self._receiver.fileno()

    def subscribe(
        self, channel: str, handler: Callable[[str, bytes], object], **limits: Any
    ) -> Subscription:
        subscription = super().subscribe(channel, handler, **limits)
        with self._lock:
            self._queues[channel] = collections.deque(maxlen=subscription.most_waiting)
            self._assembler.hear(channel, subscription.max_size)
        return subscription

    def unsubscribe(self, subscription: Subscription) -> None:
        super().unsubscribe(subscription)
        with self._lock:
            if not self.hears(subscription.channel):
                del self._queues[subscription.channel]
                self._assembler.ignore(subscription.channel)

    def publish(self, channel: str, data: bytes) -> None:
        """Sends a message; raises OSError if the network does not take it."""
        number = next(self._numbers) & 0xFFFFFFFF
        for index, datagram in enumerate(datagrams(channel, data, number, self._trailer)):
            if index and index % _BURST == 0:
                time.sleep(_PAUSE)
            sent = self._seal.sealed(datagram) if self._seal else datagram
            self._sender.sendto(sent, self._to)

    def wait(self, timeout: float) -> None:
        with self._lock:
            if any(self._queues.values()):
                return
            self._asked = math.inf  # whoever waits looks himself
        select.select([self._receiver], [], [], timeout)
        self._asked = time.monotonic()

    def hand_over(self) -> bool:
        with self._lock:
            self._asked = time.monotonic()
            self._read()
            waiting = [(queue[0][0], channel) for channel, queue in self._queues.items() if queue]
            if not waiting:
                return False
            _, channel = min(waiting)
            _, data = self._queues[channel].popleft()
        self._take(channel, data)
        return True

    def summary(self) -> dict:
        dropped = dict(self._assembler.dropped)
        with contextlib.suppress(OSError):  # not every system counts them
            memory = self._receiver.getsockopt(socket.SOL_SOCKET, _MEMORY, _NUMBERS.size)
            if lost := _NUMBERS.unpack(memory)[_DROPS]:
                dropped[NO_ROOM] = lost
        return {"received": self._datagrams, "dropped": dropped}

    def _read(self):
        """Puts what has come into the queues; to be called under the lock."""
        for _ in range(_AT_ONCE):
            try:
                size, sender = self._receiver.recvfrom_into(self._buffer)
            except OSError:  # nothing more, or the network has gone
                return
            self._datagrams += 1
            datagram = self._buffer[:size]
            try:
                if self._seal:
                    datagram, sender = self._seal.opened(datagram)
            except Dropped as e:
                self._assembler.dropped[e.args[0]] += 1
                continue
            if message := self._assembler.take(datagram, sender):
                channel, data = message
                queue = self._queues[channel]
                if len(queue) == queue.maxlen:
                    self._assembler.dropped[OVERTAKEN] += 1
                queue.append((next(self._order), data))

    def _stand_in(self):
        """Reads whenever nobody has asked for a message for a while."""
        while not self._closed.is_set():
            if self._is_asked():
                time.sleep(_ABSENT)
                continue
            with contextlib.suppress(OSError, ValueError):  # it is closed meanwhile
                select.select([self._receiver], [], [], _ABSENT)
            with self._lock:
                if not self._is_asked():
                    self._read()

    def _is_asked(self):
        return time.monotonic() - self._asked < _ABSENT


def _sockets(address: _Address) -> tuple[socket.socket, socket.socket]:
    """Returns one to send with and one to receive with; raises OSError."""
    group = socket.inet_aton(address.group)
    sender, receiver = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as trial:
            trial.connect((address.group, address.port))  # or there is no route
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, address.ttl)
        receiver.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, address.buffer)
        receiver.bind((address.group, address.port))  # not what is sent to this computer alone
        membership = group + socket.inet_aton("0.0.0.0")  # where the route leads
        for each in (sender, receiver):
            each.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
        receiver.setblocking(False)
    except OSError:
        sender.close()
        receiver.close()
        raise
    return sender, receiver
