"""What pilot and navigator tell each other, as two processes of one computer.

It goes over a pair of local sockets, not over the link to the simulation: a cable that is pulled
must not part the two. Neither of them ever waits for the other: what does not fit into the
socket's buffer, since the other one is busy, is lost.
"""

import collections
import contextlib
import pickle
import socket
import struct
from typing import Any, NamedTuple, Protocol

_BUFFER = 1 << 20  # bytes; the kernel may give less
_CHUNK = 1 << 16  # bytes that are taken at a time
_LENGTH = struct.Struct("=I")  # of a message, before it

# What a message can say, beside the values.
SETUP = "setup"  # (SETUP, what the navigator needs to know to begin)
COMPILING = "compiling"  # (COMPILING, how many functions are done)
PLAYING = "playing"  # (PLAYING, None): the navigator flies by made-up messages, see Budget
WARM = "warm"  # (WARM, time that it takes for a second of them, s): it listens from now on
RESUME = "resume"  # (RESUME, folder of a checkpoint)
READY = "ready"  # (READY, None): the navigator's values are sound from now on
STATES = "states"  # (STATES, what the pilot knows), for the checkpoint
ENDED = "ended"  # (ENDED, what went wrong)


class Handed(NamedTuple):
    """A message from one to the other.

    Attributes:
        time: simulated, of the values (s).
        values: name of a port to its value; a port that is missing has the value it had.
        says: one of the pairs above, or None.
    """

    time: float
    values: dict[str, Any]
    says: tuple[str, Any] | None = None


class Handover(Protocol):
    """One end."""

    def send(self, message: Handed) -> bool:
        """Sends a message; returns whether it will arrive."""
        ...

    def receive(self) -> list[Handed]:
        """Returns what has come, the oldest first."""
        ...


class QueueHandover(Handover):
    """An end in the same process; see queue_pair()."""

    def __init__(self, incoming: collections.deque, outgoing: collections.deque):
        self._incoming, self._outgoing = incoming, outgoing

    def send(self, message: Handed) -> bool:
        self._outgoing.append(message)
        return True

    def receive(self) -> list[Handed]:
        return [self._incoming.popleft() for _ in range(len(self._incoming))]


def queue_pair() -> tuple[QueueHandover, QueueHandover]:
    """Returns the two ends, in one process."""
    there: collections.deque = collections.deque()
    back: collections.deque = collections.deque()
    return QueueHandover(there, back), QueueHandover(back, there)


class SocketHandover(Handover):
    """An end in another process.

    Attributes:
        is_open: whether the other end is there.
        socket: to wait for.
    """

    def __init__(self, end: socket.socket):
        """Args: end: of socket.socketpair()."""
        end.setblocking(False)
        for option in (socket.SO_SNDBUF, socket.SO_RCVBUF):
            end.setsockopt(socket.SOL_SOCKET, option, _BUFFER)
        self.socket, self.is_open = end, True
        self._unsent = b""  # the rest of a message that did not fit into the buffer
        self._incoming = bytearray()

    def send(self, message: Handed) -> bool:
        if self._unsent:
            self._push(b"")
        if self._unsent or not self.is_open:
            return False
        data = pickle.dumps(message, pickle.HIGHEST_PROTOCOL)
        self._push(_LENGTH.pack(len(data)) + data)
        return self.is_open

    def _push(self, data):
        """Sends as much as fits of what is unsent and some bytes."""
        data = self._unsent + data
        try:
            self._unsent = data[self.socket.send(data) :]
        except BlockingIOError:
            self._unsent = data
        except OSError:
            self.is_open = False

    def receive(self) -> list[Handed]:
        with contextlib.suppress(BlockingIOError):
            while self.is_open:
                try:
                    data = self.socket.recv(_CHUNK)
                except ConnectionError:
                    data = b""
                self._incoming += data
                self.is_open = bool(data)
        messages = []
        while len(self._incoming) >= _LENGTH.size:
            end = _LENGTH.size + _LENGTH.unpack_from(self._incoming)[0]
            if len(self._incoming) < end:
                break
            messages.append(pickle.loads(self._incoming[_LENGTH.size : end]))
            del self._incoming[:end]
        return messages

    def close(self) -> None:
        """Lets the other end know that there will be no more."""
        self.socket.close()
        self.is_open = False
