"""The records of an MCAP file, none of which is believed before it was checked.

The format is that of https://mcap.dev/spec: records, each an opcode, a length and a content. What
airrace writes is attachments; chunks, compressed, with schemas, channels and messages, and a
checksum; and, if the file was closed, a summary of where all chunks are. By it, reading goes on
after a damaged chunk.
"""

import os
import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import BinaryIO, NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, ChunkIndex, Footer, Message, Schema, Statistics

MAGIC = b"\x89MCAP0\r\n"  # at both ends of the file
_HEAD = struct.Struct("<BQ")  # opcode and length of a record
_MESSAGE = struct.Struct("<HIQQ")  # of a message before its data
_FOOTER = _HEAD.size + 20  # bytes of that record
_MAX_CHUNK = 64_000_000  # bytes of a record, and of what it decompresses to
_MAX_RATIO = 100  # of all that is decompressed to the file's size
_BROKEN = (ValueError, struct.error, McapError, zstandard.ZstdError, MemoryError, OverflowError)


class Damage(NamedTuple):
    """Where a file is damaged first."""

    place: int  # bytes from its beginning
    size: int  # of the file

    @property
    def percent(self) -> float:
        """The place as a share of the file."""
        return 100.0 * self.place / self.size


class _Record(NamedTuple):
    """A record of the file as it is."""

    place: int  # where it begins
    opcode: int
    content: bytes


class LogReader:
    """Reads an MCAP file once.

    Attributes:
        schemas, channels: those met so far, by their IDs.
        written: number of messages that the file should have, None if it was not closed.
        damage: the first that was met so far, or None.
    """

    def __init__(self, file: BinaryIO, closed: bool):
        """Begins to read; closed: whether the file has an end."""
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.written: int | None = None
        self.damage: Damage | None = None
        self._file, self._closed = file, closed
        self._size = file.seek(0, os.SEEK_END)
        self._room = _MAX_CHUNK + _MAX_RATIO * self._size  # bytes still to be decompressed
        self._chunks = self._read_summary() if closed else None

    def attachments(self) -> dict[str, str]:
        """Returns the files before the first chunk, {name: text}; damaged ones are left out."""
        files = {}
        for record in self._in_sequence():
            if record.opcode == Opcode.CHUNK:
                break
            if record.opcode == Opcode.ATTACHMENT:
                try:
                    attachment = Attachment.read(_stream(record.content))
                    _check_sum(record.content[:-4], int.from_bytes(record.content[-4:], "little"))
                    files[attachment.name] = attachment.data.decode()
                except _BROKEN:
                    self._note_damage(record.place)
        return files

    def messages(self) -> Iterator[Message]:
        """Yields all messages, in the order of writing."""
        self.attachments()  # notes whether they are damaged
        for record in self._in_sequence() if self._chunks is None else self._indexed():
            if record.opcode == Opcode.CHUNK:
                try:
                    yield from self._broken_up(Chunk.read(_stream(record.content)))
                except _BROKEN:
                    self._note_damage(record.place)

    def _note_damage(self, place: int) -> None:
        if self.damage is None or place < self.damage.place:
            self.damage = Damage(place, self._size)

    def _record_at(self, place: int) -> _Record | None:
        """Returns the record at a place; None if the file ends within it."""
        self._file.seek(place)
        head = self._file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return None
        opcode, length = _HEAD.unpack(head)
        if not Opcode.HEADER <= opcode <= Opcode.DATA_END or length > _MAX_CHUNK:
            raise ValueError("it is no record")
        content = self._file.read(length)
        return _Record(place, opcode, content) if len(content) == length else None

    def _in_sequence(self) -> Iterator[_Record]:
        """Yields records from the first on, to the end of the data."""
        place, opcode = len(MAGIC), Opcode.HEADER
        while opcode != Opcode.DATA_END:
            try:
                record = self._record_at(place)
            except ValueError:
                self._note_damage(place)
                return
            if record is None:
                if self._closed:
                    self._note_damage(place)
                return
            opcode = record.opcode
            yield record
            place += _HEAD.size + len(record.content)

    def _indexed(self) -> Iterator[_Record]:
        """Yields the chunks that the summary names."""
        for place in self._chunks or ():
            try:
                record = self._record_at(place)
                if record is None or record.opcode != Opcode.CHUNK:
                    raise ValueError("it is no chunk")
            except ValueError:
                self._note_damage(place)
                continue
            yield record

    def _broken_up(self, chunk: Chunk) -> list[Message]:
        """Returns the messages of a chunk, and keeps its schemas and channels."""
        data = _decompressed(chunk, min(_MAX_CHUNK, self._room))
        self._room -= len(data)
        _check_sum(data, chunk.uncompressed_crc)
        messages = []
        for opcode, content in _records_in(data):
            if opcode == Opcode.MESSAGE:
                channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(content)
                if channel not in self.channels:
                    raise ValueError("a message has no channel")
                body = content[_MESSAGE.size :]
                messages.append(Message(channel, log_time, body, publish_time, sequence))
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._keep(opcode, content)
            else:
                raise ValueError("a chunk has no such records")
        return messages

    def _keep(self, opcode: int, content: bytes) -> None:
        """Keeps a schema or a channel."""
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(_stream(content))
            self.schemas[schema.id] = schema
        else:
            channel = Channel.read(_stream(content))
            self.channels[channel.id] = channel

    def _read_summary(self) -> list[int] | None:
        """Reads the summary; returns where the chunks are, None if it is damaged."""
        place = self._size - len(MAGIC) - _FOOTER
        try:
            footer = self._record_at(place)
            if footer is None or footer.opcode != Opcode.FOOTER:
                raise ValueError("it has no footer")
            end = Footer.read(_stream(footer.content))
            self._file.seek(end.summary_start)
            data = self._file.read(max(place - end.summary_start, 0))
            # The sum is of the footer, too, but for itself.
            rest = _HEAD.pack(Opcode.FOOTER, 20) + footer.content[:-4]
            _check_sum(data + rest, end.summary_crc)
            return self._take_summary(data)
        except _BROKEN:
            self._note_damage(max(place, 0))
            return None

    def _take_summary(self, data: bytes) -> list[int]:
        chunks = set()
        for opcode, content in _records_in(data):
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._keep(opcode, content)
            elif opcode == Opcode.CHUNK_INDEX:
                chunks.add(ChunkIndex.read(_stream(content)).chunk_start_offset)
            elif opcode == Opcode.STATISTICS:
                self.written = Statistics.read(_stream(content)).message_count
        return sorted(chunks)


def _records_in(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yields opcode and content of records that follow one another."""
    place = 0
    while place < len(data):
        opcode, length = _HEAD.unpack_from(data, place)
        place += _HEAD.size
        if length > len(data) - place:
            raise ValueError("a record is cut")
        yield opcode, data[place : place + length]
        place += length


def _stream(content: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(content))


def _check_sum(data: bytes, expected: int) -> None:
    """Raises ValueError if data do not have a checksum; 0: there is none."""
    if expected not in (0, zlib.crc32(data)):
        raise ValueError("its checksum differs")


def _decompressed(chunk: Chunk, limit: int) -> bytes:
    """Returns what a chunk holds; raises ValueError if that is more than some bytes."""
    if chunk.uncompressed_size > limit:
        raise ValueError("it is too large")
    data = chunk.data
    if chunk.compression == "zstd":
        # Where the frame itself says a size, zstandard goes by that; else by ours.
        if zstandard.frame_content_size(data) not in (-1, chunk.uncompressed_size):
            raise ValueError("it is not of the size that it says")
        data = zstandard.decompress(data, chunk.uncompressed_size)
    elif chunk.compression:
        raise ValueError(f"it is compressed by {chunk.compression}")
    if len(data) != chunk.uncompressed_size:
        raise ValueError("it is not of the size that it says")
    return data
