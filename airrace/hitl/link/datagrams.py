"""LCM's format on the wire: messages in datagrams, and back. What arrives is not trusted.

A short message is one datagram: ``LC02``, a number, the channel's name, a zero byte, the message.
A longer one is several: ``LC03``, the number, the message's size, from where in it the fragment
is, the fragment's number and how many there are; the first one goes on with the name and a zero
byte. See https://lcm-proj.github.io/lcm/content/udp-multicast-protocol.html.
"""

import collections
import dataclasses as dc
import struct
from collections.abc import Hashable, Iterator

from airrace.hitl.link.packets import MALFORMED, OVERSIZED, Dropped

LARGEST = 65535  # bytes of a datagram
# Why a datagram is dropped, beside the reasons of packets.py.
OTHER = "of other channels"
INCOMPLETE = "incomplete"
REST = "of no message that waits"
_SHORT, _LONG = struct.Struct(">4sI"), struct.Struct(">4sIIIHH")
_LC02, _LC03 = b"LC02", b"LC03"
_SHORT_PAYLOAD, _LONG_PAYLOAD = 65499, 65487  # bytes, with the name, at most, as LCM sends them
_LONGEST_NAME = 63
_LEAST = 1024  # bytes of a fragment on average
_SENDERS = 16  # whose fragments wait for the rest


def datagrams(channel: str, data: bytes, number: int, trailer: int = 0) -> Iterator[bytes]:
    """Yields the datagrams of a message, in order.

    Args:
        number: of the message, from 0; each of a sender's has another one.
        trailer: bytes that will be added to each datagram. To LCM they are the message's last.
    """
    name = channel.encode() + b"\0"
    if len(name) + len(data) + trailer <= _SHORT_PAYLOAD:
        yield b"".join((_SHORT.pack(_LC02, number), name, data))
        return
    most, view = _LONG_PAYLOAD - trailer, memoryview(data)
    starts = [0, *range(most - len(name), len(data), most)]
    for index, start in enumerate(starts):
        header = _LONG.pack(_LC03, number, len(data) + trailer, start, index, len(starts))
        end = starts[index + 1] if index + 1 < len(starts) else len(data)
        yield b"".join((header, name if index == 0 else b"", view[start:end]))


@dc.dataclass
class _Partial:
    """A message of which not all fragments have come."""

    header: tuple[int, int, int]  # number, size, how many fragments
    channel: str
    parts: dict[int, tuple[int, bytes]] = dc.field(default_factory=dict)  # from where, and what
    held: int = 0  # bytes of all parts


class Assembler:
    """Makes messages of datagrams.

    All that a datagram claims is compared with what the channel may have, and with its own length,
    before anything is copied; no memory is taken for what has not come. Of each sender one message
    waits for the rest of its fragments: they come in order, and the next message ends the wait.

    Attributes:
        limits: name of each channel that is listened to, to how large its messages may be (bytes).
        dropped: reason to count of datagrams, and messages that remained incomplete.
    """

    def __init__(self, trailer: int = 0):
        """Args: trailer: see datagrams(); what is given to take() has none any more."""
        self.limits: dict[str, int] = {}
        self.dropped: collections.Counter[str] = collections.Counter()
        self._trailer = trailer
        self._partial: dict[Hashable, _Partial] = {}  # by sender, the oldest first

    def hear(self, channel: str, max_size: int) -> None:
        """Listens to a channel from now on, with messages up to a size (bytes)."""
        self.limits[channel] = max_size

    def ignore(self, channel: str) -> None:
        """Listens to a channel no longer, nor to the rest of its messages that have begun."""
        del self.limits[channel]
        for sender, partial in [*self._partial.items()]:
            if partial.channel == channel:
                del self._partial[sender]

    def take(self, datagram: memoryview, sender: Hashable) -> tuple[str, bytes] | None:
        """Returns channel and message, if a datagram is one, or the last fragment of one."""
        try:
            kind = bytes(datagram[: len(_LC02)])
            if kind == _LC02 and len(datagram) >= _SHORT.size:
                return self._short(datagram)
            if kind == _LC03 and len(datagram) >= _LONG.size:
                return self._fragment(datagram, sender)
            raise Dropped(MALFORMED)
        except Dropped as e:
            self.dropped[e.args[0]] += 1
            return None

    def _short(self, datagram):
        channel, data = self._named(datagram[_SHORT.size :])
        if len(data) > self.limits[channel]:
            raise Dropped(OVERSIZED)
        return channel, bytes(data)

    def _fragment(self, datagram, sender):
        _, number, size, offset, index, count = _LONG.unpack_from(datagram)
        size, data = size - self._trailer, datagram[_LONG.size :]
        if index == 0:
            channel, data = self._named(data)
            if size > self.limits[channel]:
                raise Dropped(OVERSIZED)
        if index >= count or count > 2 + size // _LEAST or offset + len(data) > size:
            raise Dropped(MALFORMED)
        if index == 0:
            self._begin(sender, _Partial((number, size, count), channel))
        partial = self._partial.get(sender)
        if partial is None or partial.header != (number, size, count):
            raise Dropped(REST)
        if index in partial.parts or partial.held + len(data) > size:
            raise Dropped(MALFORMED)
        partial.parts[index] = offset, bytes(data)
        partial.held += len(data)
        if len(partial.parts) < count:
            return None
        del self._partial[sender]
        return partial.channel, _joined(partial)

    def _named(self, data):
        """Returns the channel with which data begin, and what follows."""
        name, separator, _ = bytes(data[: _LONGEST_NAME + 1]).partition(b"\0")
        if not separator:
            raise Dropped(MALFORMED)
        channel = name.decode(errors="replace")
        if channel not in self.limits:
            raise Dropped(OTHER)
        return channel, data[len(name) + 1 :]

    def _begin(self, sender, partial):
        """Waits for the fragments of a message, and no longer for what it takes the place of."""
        if sender not in self._partial and len(self._partial) == _SENDERS:
            del self._partial[next(iter(self._partial))]
            self.dropped[INCOMPLETE] += 1
        if self._partial.pop(sender, None) is not None:
            self.dropped[INCOMPLETE] += 1
        self._partial[sender] = partial


def _joined(partial: _Partial) -> bytes:
    """Returns the message of all fragments; raises Dropped unless each begins where one ends."""
    end, (_, size, count) = 0, partial.header
    for index in range(count):
        offset, data = partial.parts[index]
        if offset != end:
            raise Dropped(MALFORMED)
        end += len(data)
    if end != size:
        raise Dropped(MALFORMED)
    return b"".join(partial.parts[index][1] for index in range(count))
