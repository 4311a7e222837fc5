"""The file race.mcap while it is being written."""

import contextlib
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import foxglove
from foxglove.mcap import MCAPWriteOptions

from airrace.common.errors import UserError, words
from airrace.recording.foxglove_messages import nanoseconds
from airrace.recording.topics import make_channels

if TYPE_CHECKING:
    from airrace.recording.foxglove_server import FoxgloveServer

FILE = "race.mcap"
_FAULTS = (OSError, RuntimeError, ValueError)  # what the SDK raises
_ROOM = 1 << 20  # bytes: with less, a disk is full


class RaceLog:
    """Writes messages to the topics of a race.

    What was flushed can be read, whatever happens to this process afterwards. A
    file that was not closed lacks its index, which readers of streams do without.
    """

    def __init__(self, path: Path | None, live: "FoxgloveServer | None" = None):
        """Opens the file; one of this name is replaced.

        Args:
            path: of the file; None for none.
            live: gets all messages, too.

        Raises:
            UserError: if it cannot be written.
        """
        self._path, self._live = path, live
        # Not the SDK's global context: two races in one process have a file each.
        self._context = foxglove.Context()
        self._writer: foxglove.MCAPWriter | None = None
        self._channels: dict[str, Any] = {}
        if path is None:
            return
        try:
            self._writer = foxglove.open_mcap(
                path,
                allow_overwrite=True,
                context=self._context,
                # Threads would take the time from another race's process.
                writer_options=MCAPWriteOptions(profile="airrace", compression_threads=0),
            )
        except _FAULTS as e:
            raise UserError(
                f"{path} cannot be written ({_reason(path, e)}); make room there, write elsewhere, "
                "or race with --record none."
            ) from None
        self._channels = make_channels(self._context)

    def write(self, topic: str, time: float, message: Any) -> None:
        """Writes a message, or a dict to a topic of JSON, that is known at a time (s)."""
        if self._channels:
            self._channels[topic].log(message, log_time=nanoseconds(time))
        if self._live is not None:
            self._live.write(topic, time, message)

    def attach(self, name: str, text: str) -> None:
        """Adds a file, so that the log can be understood without others."""
        self._do(
            lambda writer: writer.attach(
                log_time=0, create_time=0, name=name, media_type="text/yaml", data=text.encode()
            )
        )

    def flush(self) -> None:
        """Hands everything so far to the operating system."""
        self._do(lambda writer: writer.flush())

    def close(self) -> None:
        """Ends the file; may be called again."""
        self._do(lambda writer: writer.close())
        self._writer = None

    def _do(self, action: Callable[[foxglove.MCAPWriter], object]) -> None:
        """Does something with the file. If that fails, the race goes on without it, and says so."""
        if self._writer is None:
            return
        try:
            action(self._writer)
        except _FAULTS as e:
            with contextlib.suppress(*_FAULTS):
                self._writer.close()  # else the SDK would try, and say, it at the end
            self._writer, self._channels = None, {}
            assert self._path is not None
            print(
                f"airrace: {self._path} cannot be written any more ({_reason(self._path, e)}): "
                "the race goes on, and is recorded up to here.",
                file=sys.stderr,
            )


def _reason(path: Path, error: Exception) -> str:
    """Returns a clause on why a file cannot be written; the SDK does not tell."""
    with contextlib.suppress(OSError):
        if shutil.disk_usage(path.parent).free < _ROOM:
            return "the disk is full"
    return words(error)
