"""The topics of race.mcap while the race goes on, for Foxglove."""

import collections
import logging
from typing import Any

import foxglove
from foxglove.websocket import ServerListener

from airrace.common.errors import UserError, words
from airrace.recording.foxglove_messages import nanoseconds
from airrace.recording.topics import make_channels

PORT = 8765  # where Foxglove looks unless told otherwise
_HOST = "127.0.0.1"


class _Listener(ServerListener):
    """Notes what somebody subscribes to."""

    def __init__(self, wanted: collections.deque[str]):
        self._wanted = wanted

    def on_subscribe(self, client, channel):
        self._wanted.append(channel.topic)


class FoxgloveServer:
    """A WebSocket server on loopback; a context manager, which ends it.

    What somebody subscribes to begins with the newest message, as some topics say something
    once only. Who is too slow loses messages; the race waits for nobody.

    Attributes:
        url: that Foxglove opens as a connection.
    """

    def __init__(self, port: int = PORT):
        """Starts to serve.

        Args:
            port: 0 for any that is free.

        Raises:
            UserError: if the port is taken.
        """
        # Clients that send rubbish or go away must not fill the terminal.
        logging.getLogger("foxglove.websocket").setLevel(logging.CRITICAL)
        # Not the SDK's global context, and not that of a file: a message that is sent again
        # must not be written again. It is kept, as channels close with their context.
        self._context = foxglove.Context()
        self._channels = make_channels(self._context)
        self._newest: dict[str, tuple[Any, int]] = {}
        # Topics that somebody has subscribed to, from a thread of the server's.
        self._wanted: collections.deque[str] = collections.deque()
        try:
            self._server = foxglove.start_server(
                name="airrace",
                host=_HOST,
                port=port,
                context=self._context,
                server_listener=_Listener(self._wanted),
            )
        except (OSError, RuntimeError) as e:
            raise UserError(
                f"Foxglove cannot be served at port {port} ({words(e)}); close the other program, "
                "or leave out --foxglove."
            ) from None
        self.url = f"ws://localhost:{self._server.port}"

    def __enter__(self) -> "FoxgloveServer":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the server."""
        self._server.stop()

    def write(self, topic: str, time: float, message: Any) -> None:
        """Sends a message, or a dict to a topic of JSON, that is known at a time (s)."""
        while self._wanted:
            wanted = self._wanted.popleft()
            if wanted in self._newest and wanted != topic:
                again, log_time = self._newest[wanted]
                self._channels[wanted].log(again, log_time=log_time)
        self._newest[topic] = message, nanoseconds(time)
        self._channels[topic].log(message, log_time=nanoseconds(time))
