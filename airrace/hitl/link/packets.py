"""From messages to bytes and back. Bytes that arrive are not trusted; they raise only Dropped."""

import dataclasses as dc
import math
import struct
import zlib
from io import BytesIO
from typing import Any

VERSION = 1
MAX_SIZE = 16 << 20  # bytes of a message; pictures of 1920 x 1080 in grey and RGBA have 10.4 MB
# Why a message is dropped.
MALFORMED = "malformed"
OVERSIZED = "oversized"
NOT_FINITE = "not finite"
FOREIGN = "of another session"
REPLAYED = "replayed or reordered"
STALE = "stale"
OVERTAKEN = "overtaken"

_HEADER = struct.Struct(">8siiqqd")  # fingerprint, and lcmt_header
_UNDER_CRC = 12  # bytes before what the checksum is of


class Dropped(Exception):
    """A message that is not used; its argument is one of the reasons above."""


@dc.dataclass(frozen=True)
class Stamp:
    """What a message says of itself."""

    session: int  # of the sender
    sequence: int  # of the message on its channel, from 1
    time: float  # simulated, when it was sent (s)


def pack(message: Any, stamp: Stamp) -> bytes:
    """Returns the bytes of a message of airrace.lcmtypes, with its stamp and checksum."""
    header = message.header
    header.crc32, header.version = 0, VERSION
    header.session, header.sequence, header.time = stamp.session, stamp.sequence, stamp.time
    data = bytearray(message.encode())
    crc = zlib.crc32(memoryview(data)[_UNDER_CRC:])
    struct.pack_into(">I", data, 8, crc)
    return bytes(data)


def unpack(data: bytes, message_type: type[Any]) -> tuple[Any, Stamp]:
    """Returns (message, Stamp) of bytes that came over a link; see stamp_of() and decode()."""
    stamp = stamp_of(data)
    return decode(data, message_type), stamp


def stamp_of(data: bytes) -> Stamp:
    """Returns the Stamp of bytes that came over a link; far quicker than decode().

    Raises:
        Dropped: if they are too large, incomplete, of another version, or their checksum is wrong.
    """
    if len(data) > MAX_SIZE:
        raise Dropped(OVERSIZED)
    if len(data) < _HEADER.size:
        raise Dropped(MALFORMED)
    _, crc, version, session, sequence, time = _HEADER.unpack_from(data)
    if version != VERSION or crc & 0xFFFFFFFF != zlib.crc32(memoryview(data)[_UNDER_CRC:]):
        raise Dropped(MALFORMED)
    if not math.isfinite(time):
        raise Dropped(NOT_FINITE)
    if sequence < 1:
        raise Dropped(MALFORMED)
    return Stamp(session, sequence, time)


def decode(data: bytes, message_type: type[Any]) -> Any:
    """Returns the message of bytes for which stamp_of() has raised nothing.

    Raises Dropped if it is of another type, or incomplete.
    """
    stream = BytesIO(data)
    try:
        message = message_type.decode(stream)
    except Exception:  # lcm-gen's code raises whatever the bytes make it run into
        raise Dropped(MALFORMED) from None
    if stream.tell() != len(data):
        raise Dropped(MALFORMED)
    return message
