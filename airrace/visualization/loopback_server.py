"""Web servers on this computer: who may ask them, and for how much."""

import logging
import socket
import urllib.parse
from collections.abc import Iterable, Sequence
from typing import Any

import tornado.httpserver
import tornado.web
import tornado.websocket

from airrace.common.errors import UserError

HOST = "localhost"
_LOOPBACK = "127.0.0.1"
_PORTS = range(7100, 7200)
_OWN_NAMES = {HOST, _LOOPBACK, "[::1]"}
MOST_CONNECTIONS = 64  # a page needs up to eight
_BODY, _HEAD, _MESSAGE, _BUFFER = 1 << 16, 1 << 14, 1 << 12, 1 << 20  # bytes that somebody sends
_IDLE, _SLOW, _PING = 60.0, 5.0, 30.0  # s: without a request, for a body, between two pings


class Visitors:
    """Whose requests are answered: those of programs and pages of this computer, and of proxies.

    A web site whose name was made to point to this computer gives itself away by Host, and one
    that opens a WebSocket by Origin. Proxies have a Host or an Origin of their own.
    """

    def __init__(self, allow_origin: Iterable[str] = ()):
        """Args: allow_origin: of proxies, such as ``https://hub.example.org``.

        Raises:
            UserError: if one is no origin.
        """
        self._origins = {_origin(text) for text in allow_origin}
        self._names = _OWN_NAMES | {origin.partition("://")[2] for origin in self._origins}

    def may_ask(self, host: str, origin: str | None) -> bool:
        """Whether a request is answered; host, origin: its headers."""
        name = host.lower()
        if name not in self._names and name.rpartition(":")[0] not in self._names:
            return False
        return origin is None or origin.lower() in self._origins | {f"http://{name}"}


def _origin(text: str) -> str:
    url = urllib.parse.urlsplit(text.lower())
    if url.scheme not in ("http", "https") or not url.netloc or "@" in url.netloc or "*" in text:
        raise UserError(
            f"--allow_origin {text}: give what the browser's address begins with, such as "
            "https://hub.example.org or https://name-7100.app.github.dev."
        )
    return f"{url.scheme}://{url.netloc}"


class Handler(tornado.web.RequestHandler):
    """Answers visitors only."""

    def prepare(self) -> None:
        headers = self.request.headers
        origin = headers.get("Origin", headers.get("Sec-Websocket-Origin"))
        if not self.settings["visitors"].may_ask(self.request.host, origin):
            raise tornado.web.HTTPError(403)

    def write_error(self, status_code: int, **kwargs: Any) -> None:
        self.set_header("Content-Type", "text/plain")
        more = "; is this a proxy's address? Then start with --allow_origin" * (status_code == 403)
        self.finish(f"{status_code}: {self._reason}{more}\n")


class SocketHandler(Handler, tornado.websocket.WebSocketHandler):
    """A WebSocket of visitors only."""

    def check_origin(self, origin: str) -> bool:
        return True  # prepare() has refused the others


class _NotFound(Handler):
    def prepare(self):
        super().prepare()
        raise tornado.web.HTTPError(404)


class _Server(tornado.httpserver.HTTPServer):
    """A server with a limited number of connections, so that the program keeps its files."""

    def initialize(self, *args: Any, **kwargs: Any) -> None:
        super().initialize(*args, **kwargs)
        self._streams: set = set()

    def handle_stream(self, stream, address):
        self._streams = {each for each in self._streams if not each.closed()}
        if len(self._streams) >= MOST_CONNECTIONS:
            stream.close()
            return
        self._streams.add(stream)
        super().handle_stream(stream, address)


def serve(rules: Sequence[tuple], visitors: Visitors) -> tuple[tornado.httpserver.HTTPServer, str]:
    """Starts a server in the running event loop; returns it, and its address.

    Args:
        rules: of a tornado.web.Application, with handlers that are a Handler.
        visitors: who may ask.

    Raises:
        UserError: if no port is free.
    """
    # Whoever sends rubbish must not fill the terminal.
    logging.getLogger("tornado").setLevel(logging.CRITICAL)
    application = tornado.web.Application(
        list(rules),
        default_handler_class=_NotFound,
        visitors=visitors,
        websocket_max_message_size=_MESSAGE,
        websocket_ping_interval=_PING,
        log_function=lambda handler: None,
    )
    listener = _bind()
    server = _Server(
        application,
        idle_connection_timeout=_IDLE,
        body_timeout=_SLOW,
        max_body_size=_BODY,
        max_header_size=_HEAD,
        max_buffer_size=_BUFFER,
    )
    server.add_socket(listener)
    return server, f"http://{HOST}:{listener.getsockname()[1]}"


def _bind() -> socket.socket:
    """Returns a socket that listens on loopback."""
    for port in _PORTS:
        try:
            listener = socket.create_server((_LOOPBACK, port))
        except OSError:
            continue
        listener.setblocking(False)
        return listener
    raise UserError(
        f"The race's page cannot be served: all ports from {_PORTS[0]} to {_PORTS[-1]} are "
        "taken; close another program, or race with --no-meshcat."
    )
