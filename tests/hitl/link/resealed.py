"""Checksums that fit what they should not."""

import struct
import zlib


def resealed(data: bytes) -> bytes:
    """Returns the message with the checksum that its bytes have."""
    if len(data) < 12:
        return data
    return data[:8] + struct.pack(">I", zlib.crc32(data[12:])) + data[12:]
