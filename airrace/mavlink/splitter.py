"""MAVLink messages out of datagrams that may hold several, parts of them, or noise."""

from typing import Any

from pymavlink.dialects.v20 import common as mavlink

LARGEST = 4096  # bytes of a datagram: all that follow each other in one are far less
_V1, _V2 = mavlink.PROTOCOL_MARKER_V1, mavlink.PROTOCOL_MARKER_V2
_SIGNED, _SIGNATURE = mavlink.MAVLINK_IFLAG_SIGNED, mavlink.MAVLINK_SIGNATURE_BLOCK_LEN


class Splitter:
    """Takes the datagrams of one sender.

    A message may be cut at the end of a datagram and go on in the next one, as serial bridges do.
    What is no message is left out, and messages beside it are taken all the same.
    """

    def __init__(self) -> None:
        self._reader, self._rest, self._has_failed = mavlink.MAVLink(None), b"", False

    def split(self, data: bytes) -> tuple[list[Any], int]:
        """Returns the messages of a datagram, and how many were found to hold something else."""
        found, is_sound, rest = self._messages(data)
        faults = 0
        if self._rest:
            continued = self._messages(self._rest + data)
            if (len(continued[0]), continued[1]) > (len(found), is_sound):
                found, is_sound, rest = continued
            else:  # what had begun in the one before does not go on here
                faults = 1
        self._rest = rest
        return found, faults + (not is_sound)

    def is_first_fault(self) -> bool:
        """Returns whether this is asked for the first time."""
        before, self._has_failed = self._has_failed, True
        return not before

    def _messages(self, data):
        """Returns the messages, whether all before the rest was of them, and the rest.

        The rest is the beginning of a message whose end is missing.
        """
        found, is_sound, i = [], bool(data), 0
        rest = b""
        while i < len(data):
            length = _length(data, i)
            if length is not None and i + length > len(data):
                rest = rest or data[i:]
            message = self._decoded(data, i, length)
            if message is None:
                is_sound = is_sound and bool(rest)
                i += 1
                continue
            if rest:  # it was noise
                is_sound, rest = False, b""
            found.append(message)
            i += length
        return found, is_sound, rest

    def _decoded(self, data, i, length):
        """Returns the message of a length at a place, None if there is none."""
        if length is None or i + length > len(data):
            return None
        try:
            message = self._reader.decode(bytearray(data[i : i + length]))
        except Exception:  # pymavlink raises errors of many kinds on bad bytes
            return None
        # Nobody knows the checksum of an unknown type: at least, it must fit in.
        is_unknown = isinstance(message, mavlink.MAVLink_unknown)
        end = i + length
        return None if is_unknown and data[end : end + 1] not in _BEGINNINGS else message


_BEGINNINGS = (b"", bytes([_V1]), bytes([_V2]))


def _length(data, i):
    """Returns how long the message is that begins at a place, None if none does."""
    if data[i] == _V1:
        return data[i + 1] + 8 if i + 1 < len(data) else 8
    if data[i] == _V2:
        signed = i + 2 < len(data) and data[i + 2] & _SIGNED
        return (data[i + 1] if i + 1 < len(data) else 0) + 12 + (_SIGNATURE if signed else 0)
    return None
