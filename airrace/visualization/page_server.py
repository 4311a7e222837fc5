"""Serves the page of a race, from a thread of its own; the race never waits for it."""

import asyncio
import concurrent.futures
import gc
import json
import socket
import threading
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import tornado.httpclient
import tornado.httpserver
import tornado.iostream
import tornado.tcpclient
import tornado.web
import tornado.websocket

from airrace.common.errors import UserError
from airrace.visualization.controls import PaceRequest
from airrace.visualization.race_record import Cursor, RaceRecord

_HOST, _LOOPBACK = "localhost", "127.0.0.1"
_PORTS = range(7100, 7200)
_PERIOD = 1 / 20  # s, between two batches that a page is sent
_MESHCAT = r"/(favicon\.ico|cas-v1/.*)"  # what its page asks for
_CHUNK = 1 << 16  # bytes
_NAP = 0.02  # s, in which small pieces of Meshcat's data gather
# Files of a race that its page links to.
FILES = {"race.html": "replay", "report.html": "report", "race.json": "race.json"}


class Source(NamedTuple):
    """What a server serves."""

    #: From Meshcat's HTML to the page; raises KeyError while there is none yet.
    make_page: Callable[[str], str]
    meshcat_port: int  #: of Drake's Meshcat on this computer
    record: RaceRecord  #: of the race
    pace: PaceRequest  #: that pages ask for


class PageServer:
    """A web server on loopback: the page, the race's record as it grows, and Drake's Meshcat.

    Meshcat has a server of its own. What is not ours is handed through to it, so that the
    page needs one port only.
    """

    def __init__(self, source: Source):
        """Starts to serve.

        Args:
            source: see there.

        Raises:
            UserError: if no port is free.
        """
        # A Meshcat must not be collected by another thread than its own: see that none waits.
        gc.collect()
        self._source = source
        self._folder: Path | None = None
        self._clients: set[_RaceSocket] = set()
        ready: concurrent.futures.Future = concurrent.futures.Future()
        self._thread = threading.Thread(target=self._run, args=(ready,), daemon=True)
        self._thread.start()
        port, self._loop, self._stop = ready.result()
        self.url = f"http://{_HOST}:{port}"

    def _run(self, ready):
        try:
            asyncio.run(self._serve(ready))
        except BaseException as e:
            if not ready.done():
                ready.set_exception(e)

    async def _serve(self, ready):
        stop = asyncio.Event()
        application = tornado.web.Application(
            [
                (r"/", _PageHandler, {"source": self._source}),
                (r"/race", _RaceSocket, {"source": self._source, "server": self}),
                (rf"/({'|'.join(FILES)})", _FileHandler, {"server": self}),
                (_MESHCAT, _MeshcatHandler, {"source": self._source}),
            ],
            websocket_max_message_size=1 << 12,
            log_function=lambda handler: None,
        )
        server = tornado.httpserver.HTTPServer(application)
        listener = _bind()
        server.add_socket(listener)
        ready.set_result((listener.getsockname()[1], asyncio.get_running_loop(), stop))
        await stop.wait()
        server.stop()
        for client in list(self._clients):
            client.close(1001, "the program has ended")
        await server.close_all_connections()

    @property
    def watching(self) -> int:
        """How many pages are connected."""
        return len(self._clients)

    @property
    def folder(self) -> Path | None:
        """Of the results that pages link to; None before there are any."""
        return self._folder

    def show_results(self, folder: Path) -> None:
        """Lets pages link to the files of a race that has ended; folder: of them."""
        self._folder = folder

    def close(self) -> None:
        """Ends the server; may be called again."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join(5.0)


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


def serve_page(html: str, announce: Callable[[str], object]) -> None:
    """Serves one page on loopback until KeyboardInterrupt.

    Args:
        html: the page.
        announce: is called with its address.

    Raises:
        UserError: if no port is free.
    """

    class Handler(tornado.web.RequestHandler):
        def get(self):
            self.finish(html)

    class NoIcon(tornado.web.RequestHandler):
        """Browsers ask for one, and a 404 would stand in their console as an error."""

        def get(self):
            self.set_status(204)

    async def serve():
        application = tornado.web.Application(
            [(r"/", Handler), (r"/favicon\.ico", NoIcon)], log_function=lambda handler: None
        )
        listener = _bind()
        tornado.httpserver.HTTPServer(application).add_socket(listener)
        announce(f"http://{_HOST}:{listener.getsockname()[1]}")
        await asyncio.Event().wait()

    asyncio.run(serve())


class _PageHandler(tornado.web.RequestHandler):
    """The page; and on the same path, as Drake's page wants it, Meshcat's WebSocket."""

    def initialize(self, source):
        self._source = source

    async def get(self):
        if self.request.headers.get("Upgrade", "").lower() == "websocket":
            await self._hand_through()
            return
        try:
            html = (await _fetch(self._source, "")).body.decode()
            self.finish(self._source.make_page(html))
        except KeyError:
            self.set_header("Refresh", "1")
            self.finish("The race is being prepared.")

    async def _hand_through(self):
        """Joins the browser with Meshcat's server; what they say is none of our business."""
        request = self.request
        origin = request.headers.get("Origin", "")
        if origin and origin.split("://")[-1] != request.host:
            raise tornado.web.HTTPError(403)
        try:
            theirs = await tornado.tcpclient.TCPClient().connect(
                _LOOPBACK, self._source.meshcat_port
            )
        except OSError:
            raise tornado.web.HTTPError(502) from None
        lines = [f"{request.method} {request.uri} HTTP/1.1"]
        lines += [f"{name}: {value}" for name, value in request.headers.get_all()]
        ours = self.detach()
        await theirs.write("\r\n".join([*lines, "", ""]).encode())
        await asyncio.gather(_pump(ours, theirs, 0.0), _pump(theirs, ours, _NAP))


async def _pump(source, sink, nap):
    """Hands bytes through until one side closes; nap: to gather small pieces (s)."""
    try:
        while True:
            data = await source.read_bytes(_CHUNK, partial=True)
            await sink.write(data)
            if len(data) < _CHUNK:
                await asyncio.sleep(nap)
    except tornado.iostream.StreamClosedError:
        pass
    finally:
        source.close()
        sink.close()


async def _fetch(source, path):
    client = tornado.httpclient.AsyncHTTPClient()
    try:
        return await client.fetch(f"http://{_LOOPBACK}:{source.meshcat_port}/{path}")
    except (OSError, tornado.httpclient.HTTPError):
        raise tornado.web.HTTPError(404) from None


class _MeshcatHandler(tornado.web.RequestHandler):
    """Files that Meshcat's page asks for."""

    def initialize(self, source):
        self._source = source

    async def get(self, path):
        answer = await _fetch(self._source, path)
        self.set_header("Content-Type", answer.headers.get("Content-Type", "text/plain"))
        self.finish(answer.body)


class _FileHandler(tornado.web.RequestHandler):
    """Files that a race left, when it has ended."""

    def initialize(self, server):
        self._server = server

    def get(self, name):
        path = self._server.folder and self._server.folder / name
        if path is None or not path.is_file():
            raise tornado.web.HTTPError(404)
        if name.endswith(".json"):
            self.set_header("Content-Type", "application/json")
        self.finish(path.read_bytes())


class _RaceSocket(tornado.websocket.WebSocketHandler):
    """Sends a page what is new of the record; a slow one gets more at once, and less often."""

    def initialize(self, source, server):
        self._source, self._server = source, server

    def open(self, *args, **kwargs):
        self._server._clients.add(self)
        self._task = asyncio.ensure_future(self._send())  # it lives as long as it is kept

    def on_close(self):
        self._server._clients.discard(self)

    def on_message(self, message):
        try:
            self._source.pace.receive(json.loads(message))
        except ValueError:
            pass  # no page of ours sends it

    async def _send(self):
        cursor: Cursor = {}
        pace = folder = None
        try:
            while True:
                batch, cursor = self._source.record.since(cursor)
                if (now := self._source.pace.now) != pace:
                    pace = now
                    batch["controls"] = now._asdict() if now else None
                if self._server.folder != folder:
                    folder = self._server.folder
                    batch["links"] = [
                        [text, name] for name, text in FILES.items() if (folder / name).exists()
                    ]
                if batch:
                    await self.write_message(json.dumps(batch, allow_nan=False))
                await asyncio.sleep(_PERIOD)
        except tornado.websocket.WebSocketClosedError:
            pass
