"""Whole messages over a socket of streams, between a process and the one that it started.

No port and no address: what the socket is not handed to cannot speak on it.
"""

import select
import socket
import struct
import subprocess
import time

from airrace.common.python_path import module_command
from airrace.hitl.link.packets import MAX_SIZE

_LENGTH = struct.Struct(">I")  # of a message, before it
LARGEST = MAX_SIZE + 256  # bytes of a message: one of the link, and its channel's name
_READ = 1 << 18  # bytes at a time
_BUFFER = 1 << 20  # bytes; the kernel may give less
MOST_WAITING = 32 << 20  # bytes that wait to be sent; what comes on top is lost, as on any link


class MessageSocket:
    """Sends and receives messages, in order. Nothing here blocks but wait().

    Attributes:
        received: bytes that have come.
        is_broken: whether the other side has closed its end, or sent what is no message.
    """

    def __init__(self, end: socket.socket, most_waiting: int | None = None):
        """Args: end: of socket.socketpair(). most_waiting: bytes, MOST_WAITING by default."""
        end.setblocking(False)
        for option in (socket.SO_SNDBUF, socket.SO_RCVBUF):
            end.setsockopt(socket.SOL_SOCKET, option, _BUFFER)
        self._socket = end
        self._most_waiting = MOST_WAITING if most_waiting is None else most_waiting
        self._outgoing, self._incoming = bytearray(), bytearray()
        self.received, self.is_broken = 0, False

    def fileno(self) -> int:
        """Returns the socket's, for select()."""
        return self._socket.fileno()

    def close(self) -> None:
        """Closes this end."""
        self._socket.close()
        self.is_broken = True

    def send(self, data: bytes) -> bool:
        """Sends a message, or loses it if too much waits already; returns whether it will arrive.

        What the other side does not read waits, and is sent whenever this side sends, receives or
        waits.
        """
        self._push()
        if self._outgoing and len(self._outgoing) + len(data) > self._most_waiting:
            return False
        self._outgoing += _LENGTH.pack(len(data)) + data
        self._push()
        return not self.is_broken

    def receive(self) -> bytes | None:
        """Returns the next message if all of it has come."""
        self._push()
        message = self._next()
        if message is None and not self.is_broken:
            self._read()
            message = self._next()
        return message

    def wait(self, timeout: float) -> None:
        """Waits until a message may have come, at most some time (s); sends meanwhile."""
        end = time.monotonic() + timeout
        while not self.is_broken:
            writers = [self._socket] if self._outgoing else []
            left = max(end - time.monotonic(), 0.0)
            readable, _, _ = select.select([self._socket], writers, [], left)
            self._push()
            if readable or time.monotonic() >= end:
                return
        time.sleep(timeout)  # nothing comes any more: whoever asks again does not spin

    def wait_for_message(self) -> bytes | None:
        """Returns the next message, as soon as it has come; None if none will."""
        while (message := self.receive()) is None and not self.is_broken:
            self.wait(1.0)
        return message

    def give_up(self) -> None:
        """Forgets what has come and what waits: what has come is no message."""
        self.is_broken = True
        self._incoming.clear()
        self._outgoing.clear()

    def _next(self) -> bytes | None:
        """Takes the next whole message from what has come."""
        if len(self._incoming) < _LENGTH.size:
            return None
        (length,) = _LENGTH.unpack_from(self._incoming)
        if length > LARGEST:
            self.give_up()
        end = _LENGTH.size + length
        if len(self._incoming) < end:
            return None
        data = bytes(memoryview(self._incoming)[_LENGTH.size : end])
        del self._incoming[:end]
        return data

    def _read(self) -> None:
        try:
            data = self._socket.recv(_READ)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self.give_up()
        self.received += len(data)
        self._incoming += data

    def _push(self) -> None:
        """Sends what the other side takes now."""
        while self._outgoing and not self.is_broken:
            try:
                sent = self._socket.send(self._outgoing[:_READ])
            except OSError:  # it takes no more now, or has gone: what it sent can still be read
                return
            del self._outgoing[:sent]


def start_module(module: str) -> tuple[subprocess.Popen, socket.socket]:
    """Starts `python -m module FD`, whose end of a pair of sockets has the number FD.

    Returns the process, and this side's end.
    """
    here, there = socket.socketpair()
    with there:
        process = subprocess.Popen(
            module_command(module, str(there.fileno())),
            stdin=subprocess.DEVNULL,
            pass_fds=[there.fileno()],
        )
    return process, here
