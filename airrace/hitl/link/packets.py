"""From messages to bytes and back. Bytes that arrive are not trusted; they raise only Dropped."""

import dataclasses as dc
import math
import re
import struct
import zlib
from io import BytesIO

from drake import lcmt_image_array

VERSION = 1
# Why a message is dropped.
MALFORMED = "malformed"
OVERSIZED = "oversized"
NOT_FINITE = "not finite"
FOREIGN = "of another session"
REPLAYED = "replayed or reordered"
STALE = "stale"
REASONS = (MALFORMED, OVERSIZED, NOT_FINITE, FOREIGN, REPLAYED, STALE)

_HEADER = struct.Struct(">8siiqqd")  # fingerprint, and lcmt_header
_UNDER_CRC = 12  # bytes before what the checksum is of
# Drake's image type has no room for these but in its frame name; hexadecimal, so
# that its length is always the same.
_STAMP = "airrace {:x} session {:016x} sequence {:016x} time {:016x} crc "
_STAMP_PATTERN = re.compile(
    rb"airrace (\w+) session (\w{16}) sequence (\w{16}) time (\w{16}) crc (\w{8})"
)
_STAMP_REACH = 200  # bytes from the start, within which it is


class Dropped(Exception):
    """A message that is not used; its argument is one of the reasons above."""


@dc.dataclass(frozen=True)
class Stamp:
    """What a message says of itself.

    Attributes:
        session: of the sender.
        sequence: of the message on its channel, from 1.
        time: simulated, when it was sent (s).
    """

    session: int
    sequence: int
    time: float


def pack(message, stamp: Stamp) -> bytes:
    """Returns the bytes of a message with its stamp and checksum.

    Args:
        message: of airrace.lcmtypes with a header, or an lcmt_image_array.
        stamp: takes the place of what the message says.
    """
    if isinstance(message, lcmt_image_array):
        time = int.from_bytes(struct.pack(">d", stamp.time))
        text = _STAMP.format(VERSION, stamp.session, stamp.sequence, time)
        message.header.seq = stamp.sequence & 0x7FFFFFFF
        message.header.utime = round(stamp.time * 1e6)
        message.header.frame_name = text + "00000000"
        data = message.encode()
        at = data.index(text.encode()) + len(text)
        return b"%b%08x%b" % (data[:at], zlib.crc32(data), data[at + 8 :])
    header = message.header
    header.crc32, header.version = 0, VERSION
    header.session, header.sequence, header.time = stamp.session, stamp.sequence, stamp.time
    data = bytearray(message.encode())
    crc = zlib.crc32(memoryview(data)[_UNDER_CRC:])
    struct.pack_into(">I", data, 8, crc)
    return bytes(data)


def unpack(data: bytes, message_type, max_size: int):
    """Returns (message, Stamp) of bytes that came over a link.

    Args:
        data: whatever came.
        message_type: what it should be, see pack().
        max_size: of the data.

    Raises:
        Dropped: if it is too large, incomplete, of another type or version, or its
            checksum is wrong.
    """
    if len(data) > max_size:
        raise Dropped(OVERSIZED)
    stamp = _image_stamp(data) if message_type is lcmt_image_array else _stamp(data)
    if not math.isfinite(stamp.time):
        raise Dropped(NOT_FINITE)
    if stamp.sequence < 1:
        raise Dropped(MALFORMED)
    stream = BytesIO(data)
    try:
        message = message_type.decode(stream)
    except Exception:  # lcm-gen's code raises whatever the bytes make it run into
        raise Dropped(MALFORMED) from None
    if stream.tell() != len(data):
        raise Dropped(MALFORMED)
    return message, stamp


def _stamp(data) -> Stamp:
    if len(data) < _HEADER.size:
        raise Dropped(MALFORMED)
    _, crc, version, session, sequence, time = _HEADER.unpack_from(data)
    if version != VERSION or crc & 0xFFFFFFFF != zlib.crc32(memoryview(data)[_UNDER_CRC:]):
        raise Dropped(MALFORMED)
    return Stamp(session, sequence, time)


def _image_stamp(data) -> Stamp:
    found = _STAMP_PATTERN.search(data, 0, _STAMP_REACH)
    if found is None:
        raise Dropped(MALFORMED)
    try:
        version, session, sequence, time, crc = (int(number, 16) for number in found.groups())
    except ValueError:
        raise Dropped(MALFORMED) from None
    at = found.start(5)
    blank = zlib.crc32(memoryview(data)[at + 8 :], zlib.crc32(b"00000000", zlib.crc32(data[:at])))
    if version != VERSION or crc != blank:
        raise Dropped(MALFORMED)
    return Stamp(session, sequence, struct.unpack(">d", time.to_bytes(8))[0])
