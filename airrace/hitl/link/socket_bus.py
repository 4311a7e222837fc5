"""The link over a socket that is connected already: between a process and the one that it started.

No port and no address: what the socket is not handed to cannot speak on it.
"""

import select
import socket
import struct
import time
import types
from collections.abc import Callable

from airrace.hitl.link.packets import MAX_SIZE

_HEAD = struct.Struct(">HI")  # bytes of the channel's name, and of the message
_LONGEST_NAME = 64
_READ = 1 << 18  # bytes at a time
MOST_WAITING = 32 << 20  # bytes that wait to be sent; what comes on top is lost, as on any link


class SocketBus:
    """Stands in for an lcm.LCM, for two processes that share a pair of sockets.

    Each message is its channel's name and its bytes, with their lengths in front. Nothing here
    blocks: what the other side does not read waits, and is sent whenever this side looks for
    messages.

    Attributes:
        received: bytes that have come, of all channels.
        is_broken: whether the other side has closed its end, or sent what is no message.
    """

    def __init__(self, end: socket.socket):
        """Args: end: one of socket.socketpair(), of streams."""
        end.setblocking(False)
        self._socket = end
        self._handlers: dict[str, list[types.SimpleNamespace]] = {}
        self._outgoing = bytearray()
        self._incoming = bytearray()
        self.received, self.is_broken = 0, False

    def fileno(self) -> int:
        """Returns the socket's, for select()."""
        return self._socket.fileno()

    def close(self) -> None:
        """Closes this end."""
        self._socket.close()

    def publish(self, channel: str, data: bytes) -> None:
        """Sends a message, or loses it if too much waits already."""
        name = channel.encode()
        if len(self._outgoing) + len(data) <= MOST_WAITING:
            self._outgoing += _HEAD.pack(len(name), len(data)) + name + data
        self._send()

    def subscribe(
        self, channel: str, handler: Callable[[str, bytes], object]
    ) -> types.SimpleNamespace:
        """Hands all messages of a channel to handler(channel, data)."""
        subscription = types.SimpleNamespace(
            channel=channel, handler=handler, set_queue_capacity=lambda number: None
        )
        self._handlers.setdefault(channel, []).append(subscription)
        return subscription

    def unsubscribe(self, subscription: types.SimpleNamespace) -> None:
        """Ends a subscription."""
        self._handlers[subscription.channel].remove(subscription)

    def wait(self, timeout: float) -> None:
        """Waits until a message may have come, at most some time (s); sends meanwhile."""
        end = time.monotonic() + timeout
        while not self.is_broken:
            writers = [self._socket] if self._outgoing else []
            left = max(end - time.monotonic(), 0.0)
            readable, _, _ = select.select([self._socket], writers, [], left)
            self._send()
            if readable or time.monotonic() >= end:
                return
        time.sleep(timeout)  # nothing comes any more: whoever asks again does not spin

    def handle_timeout(self, _: int) -> int:
        """Hands over the next message that has come; returns whether there was one."""
        self._send()
        message = self._next()
        if message is None:
            self._read()
            message = self._next()
        if message is None:
            return 0
        channel, data = message
        self._take(channel, data)
        return 1

    def _take(self, channel: str, data: bytes) -> None:
        for subscription in self._handlers.get(channel, ()):
            subscription.handler(channel, data)

    def _next(self) -> tuple[str, bytes] | None:
        """Takes the next whole message from what has come, or returns None."""
        if len(self._incoming) < _HEAD.size:
            return None
        named, length = _HEAD.unpack_from(self._incoming)
        if named > _LONGEST_NAME or length > MAX_SIZE:
            self._break()
            return None
        start, end = _HEAD.size + named, _HEAD.size + named + length
        if len(self._incoming) < end:
            return None
        channel = self._incoming[_HEAD.size : start].decode(errors="replace")
        data = bytes(memoryview(self._incoming)[start:end])
        del self._incoming[:end]
        return channel, data

    def _read(self) -> None:
        if self.is_broken:
            return
        try:
            data = self._socket.recv(_READ)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._break()
            return
        self.received += len(data)
        self._incoming += data

    def _send(self) -> None:
        """Sends what the other side takes now."""
        while self._outgoing and not self.is_broken:
            try:
                sent = self._socket.send(self._outgoing[:_READ])
            except OSError:  # it takes no more now, or has gone: what it sent can still be read
                return
            del self._outgoing[:sent]

    def _break(self) -> None:
        self.is_broken = True
        self._incoming.clear()
        self._outgoing.clear()
