"""The file race.mcap while it is being written."""

import contextlib
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
        with self._writing():
            self._writer = foxglove.open_mcap(
                path,
                allow_overwrite=True,
                context=self._context,
                # Threads would take the time from another race's process.
                writer_options=MCAPWriteOptions(profile="airrace", compression_threads=0),
            )
        self._channels = make_channels(self._context)

    def write(self, topic: str, time: float, message: Any) -> None:
        """Writes a message, or a dict to a topic of JSON, that is known at a time (s)."""
        if self._channels:
            self._channels[topic].log(message, log_time=nanoseconds(time))
        if self._live is not None:
            self._live.write(topic, time, message)

    def attach(self, name: str, text: str) -> None:
        """Adds a file, so that the log can be understood without others.

        Raises:
            UserError: if it cannot be written.
        """
        if self._writer is not None:
            with self._writing():
                self._writer.attach(
                    log_time=0, create_time=0, name=name, media_type="text/yaml", data=text.encode()
                )

    def flush(self) -> None:
        """Hands everything so far to the operating system.

        Raises:
            UserError: if it cannot be written.
        """
        if self._writer is not None:
            with self._writing():
                self._writer.flush()

    def close(self) -> None:
        """Ends the file; may be called again.

        Raises:
            UserError: if it cannot be written.
        """
        if self._writer is not None:
            with self._writing():
                self._writer.close()
            self._writer = None

    @contextlib.contextmanager
    def _writing(self):
        """For what is done with the file; after it failed, there is no file any more."""
        try:
            yield
        except (OSError, RuntimeError, ValueError) as e:
            self._writer = None  # at the interpreter's end, the SDK would say it once more
            raise UserError(
                f"{self._path} cannot be written ({words(e)}); make room "
                "there, write elsewhere, or race with --record none."
            ) from None
