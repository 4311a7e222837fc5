"""Reads race.mcap, also one whose race was killed, and what is left of one that is damaged."""

import contextlib
import json
import os
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from google.protobuf.message import DecodeError
from mcap.exceptions import McapError
from mcap.records import Channel, Schema
from mcap_protobuf.decoder import DecoderFactory as ProtobufFactory

from airrace.analysis.log_records import MAGIC, Damage, LogReader
from airrace.common.errors import UserError
from airrace.common.files import open_regular

# What code meets that reads a message of another shape than it expects.
_MISFITS = (
    *(ArithmeticError, AttributeError, LookupError, RuntimeError, TypeError, ValueError),
    *(DecodeError, McapError),
)


def read_log(path: Path, topics: Iterable[str] | None = None) -> Iterator[tuple[str, float, Any]]:
    """Yields topic, time (s) and message of everything in a log, in the order of writing.

    A message is a Protobuf object of Foxglove's schema, or a dict. A log that ends in the
    middle of something, because its race was killed, is read up to there. What is damaged is left
    out; log_damage() tells.

    Args:
        path: the file.
        topics: only these; None: all.

    Raises:
        UserError: if there is no such file, it is no log, or a message is none of airrace's.
    """
    closed = is_complete(path)
    wanted = None if topics is None else {*topics}
    decoders: dict[int, Callable[[bytes], Any]] = {}
    factory = ProtobufFactory()
    with open(path, "rb") as file:
        reader = LogReader(file, closed)
        for message in reader.messages():
            channel = reader.channels[message.channel_id]
            if wanted is not None and channel.topic not in wanted:
                continue
            with reading(path, f"a message of {channel.topic}"):
                if channel.id not in decoders:
                    schema = reader.schemas.get(channel.schema_id)
                    decoders[channel.id] = _decoder(channel, schema, factory)
                value = decoders[channel.id](message.data)
            yield channel.topic, message.log_time / 1e9, value


def _decoder(
    channel: Channel, schema: Schema | None, factory: ProtobufFactory
) -> Callable[[bytes], Any]:
    """Returns what decodes the messages of a channel; raises ValueError if there is nothing."""
    if channel.message_encoding == "json":
        return json.loads
    decoder = factory.decoder_for(channel.message_encoding, schema)
    if decoder is None:
        raise ValueError
    return decoder


@contextlib.contextmanager
def reading(path: Path, what: str) -> Iterator[None]:
    """For what looks into a log: if something there is of another shape, raises UserError.

    Args: path: of the log, or of a file beside it. what: is looked at, such as "a message of /map".
    """
    try:
        yield
    except _MISFITS as e:
        raise UserError(
            f"{path}: {what} is not as this airrace writes it; fly the run's scenario.yaml again."
        ) from e


def log_damage(path: Path) -> str | None:
    """Returns a sentence on what of a log is damaged, None if nothing is.

    A log whose race was killed ends somewhere, and is not damaged by that.

    Raises:
        UserError: if there is no such file or it is no log.
    """
    closed = is_complete(path)
    with open(path, "rb") as file:
        reader = LogReader(file, closed)
        left = sum(1 for _ in reader.messages())
        total, damage = reader.written, reader.damage
    if damage is None and total in (None, left):
        return None
    at = damage or Damage(0, path.stat().st_size)
    of = "" if total is None else f" of {total}"
    return (
        f"{path} is damaged at {at.percent:.0f} %: {left}{of} messages are left, and what is made "
        "of them lacks the others; fly the run's scenario.yaml again."
    )


def read_attachments(path: Path) -> dict[str, str]:
    """Returns the files that a log begins with, {name: text}.

    Raises:
        UserError: if there is no such file or it is no log.
    """
    closed = is_complete(path)
    with open(path, "rb") as file:
        return LogReader(file, closed).attachments()


def is_complete(path: Path) -> bool:
    """Returns whether a log was closed; else its race was killed, or still goes on.

    Raises:
        UserError: if there is no such file or it is no log.
    """
    try:
        with open_regular(path) as file:
            begin = file.read(len(MAGIC))
            size = file.seek(0, os.SEEK_END)
            file.seek(max(size - len(MAGIC), 0))
            end = file.read()
    except OSError as e:
        raise UserError(
            f"{path} cannot be read ({e.strerror}); name a run that was recorded, "
            "--record light or full."
        ) from None
    if begin != MAGIC:
        raise UserError(f"{path} is no MCAP file; name a race.mcap that airrace wrote.")
    return size > 2 * len(MAGIC) and end == MAGIC
