"""Reads race.mcap, also one whose race was killed."""

import contextlib
import json
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from mcap.decoder import DecoderFactory
from mcap.reader import NonSeekingReader
from mcap.records import Attachment, Chunk
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory as ProtobufFactory

from airrace.common.errors import UserError

_MAGIC = b"\x89MCAP0\r\n"  # at both ends of the file


def read_log(path: Path, topics: Iterable[str] | None = None) -> Iterator[tuple[str, float, Any]]:
    """Yields topic, time (s) and message of everything in a log, in the order of writing.

    A message is a Protobuf object of Foxglove's schema, or a dict. A log that ends in the
    middle of something, because its race was killed, is read up to there.

    Args:
        path: the file.
        topics: only these; None: all.

    Raises:
        UserError: if there is no such file or it is no log.
    """
    is_complete(path)
    factories = [ProtobufFactory(), _JsonFactory()]
    # A log may end in the middle of whatever.
    with open(path, "rb") as file, contextlib.suppress(Exception):
        reader = NonSeekingReader(file, decoder_factories=factories)
        for _, channel, message, value in reader.iter_decoded_messages(
            topics, log_time_order=False
        ):
            yield channel.topic, message.log_time / 1e9, value


class _JsonFactory(DecoderFactory):
    """Decodes messages of JSON for mcap."""

    def decoder_for(self, message_encoding, schema):
        return json.loads if message_encoding == "json" else None


def read_attachments(path: Path) -> dict:
    """Returns the files that a log begins with, {name: text}.

    Raises:
        UserError: if there is no such file or it is no log.
    """
    is_complete(path)
    files = {}
    with open(path, "rb") as file, contextlib.suppress(Exception):  # a log may end anywhere
        for record in StreamReader(file, emit_chunks=True).records:
            if isinstance(record, Attachment):
                files[record.name] = record.data.decode()
            elif isinstance(record, Chunk):
                break
    return files


def is_complete(path: Path) -> bool:
    """Returns whether a log was closed; else its race was killed, or still goes on.

    Raises:
        UserError: if there is no such file or it is no log.
    """
    try:
        with open(path, "rb") as file:
            begin = file.read(len(_MAGIC))
            size = file.seek(0, os.SEEK_END)
            file.seek(max(size - len(_MAGIC), 0))
            end = file.read()
    except OSError as e:
        raise UserError(
            f"{path} cannot be read ({e.strerror}); name a run that was recorded, "
            "--record light or full."
        ) from None
    if begin != _MAGIC:
        raise UserError(f"{path} is no MCAP file; name a race.mcap that airrace wrote.")
    return size > 2 * len(_MAGIC) and end == _MAGIC
