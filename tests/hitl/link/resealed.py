"""Checksums that fit what they should not."""

import struct
import zlib

from airrace.hitl.link.packets import _STAMP_PATTERN, _STAMP_REACH


def resealed(data: bytes) -> bytes:
    """Returns the message with the checksum that its bytes have."""
    found = _STAMP_PATTERN.search(data, 0, _STAMP_REACH)
    if found is not None:
        at = found.start(5)
        blank = data[:at] + b"00000000" + data[at + 8 :]
        return data[:at] + b"%08x" % zlib.crc32(blank) + data[at + 8 :]
    if len(data) < 12:
        return data
    return data[:8] + struct.pack(">I", zlib.crc32(data[12:])) + data[12:]
