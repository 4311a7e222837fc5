"""Serves the page of a race, from a thread of its own; the race never waits for it."""

import asyncio
import concurrent.futures
import gc
import json
import re
import threading
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import tornado.httpclient
import tornado.web
import tornado.websocket

from airrace.visualization.controls import PaceRequest
from airrace.visualization.loopback_server import Handler, SocketHandler, Visitors, serve
from airrace.visualization.race_record import Cursor, RaceRecord

_PERIOD = 1 / 20  # s, between two batches that a page is sent
_MESHCAT = r"/(favicon\.ico|cas-v1/\w+)"  # what its page asks for
_SCENE = 1 << 28  # bytes, of one message of Meshcat's
# What a connection raises that one side has closed.
_GONE = (OSError, tornado.httpclient.HTTPError, tornado.websocket.WebSocketClosedError)
# Files of a race that its page links to.
FILES = {"race.html": "replay", "report.html": "report", "race.json": "race.json"}


class Source(NamedTuple):
    """What a server serves."""

    #: From Meshcat's HTML to the page; raises KeyError while there is none yet.
    make_page: Callable[[str], str]
    meshcat: str  #: host and port of Drake's Meshcat on this computer
    record: RaceRecord  #: of the race
    pace: PaceRequest  #: that pages ask for
    visitors: Visitors = Visitors()  #: who may ask


class PageServer:
    """A web server on loopback: the page, the race's record as it grows, and Drake's Meshcat.

    Meshcat has a server of its own. What it says is handed on from there, so that the page needs
    one port only, and Meshcat hears no page.
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
        self.url, self._loop, self._stop = ready.result()

    def _run(self, ready):
        try:
            asyncio.run(self._serve(ready))
        except BaseException as e:
            if not ready.done():
                ready.set_exception(e)

    async def _serve(self, ready):
        stop = asyncio.Event()
        rules = [
            (r"/", _PageHandler, {"source": self._source}),
            (r"/race", _RaceSocket, {"source": self._source, "server": self}),
            (rf"/({'|'.join(map(re.escape, FILES))})", _FileHandler, {"server": self}),
            (_MESHCAT, _MeshcatHandler, {"source": self._source}),
        ]
        server, url = serve(rules, self._source.visitors)
        ready.set_result((url, asyncio.get_running_loop(), stop))
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


def serve_page(
    html: str, announce: Callable[[str], object], visitors: Visitors = Visitors()
) -> None:
    """Serves one page on loopback until KeyboardInterrupt.

    Args:
        html: the page.
        announce: is called with its address.
        visitors: who may ask.

    Raises:
        UserError: if no port is free.
    """

    class Page(Handler):
        def get(self):
            self.finish(html)

    class NoIcon(Handler):
        """Browsers ask for one, and a 404 would stand in their console as an error."""

        def get(self):
            self.set_status(204)

    async def run():
        _, url = serve([(r"/", Page), (r"/favicon\.ico", NoIcon)], visitors)
        announce(url)
        await asyncio.Event().wait()

    asyncio.run(run())


class _PageHandler(SocketHandler):
    """The page; and on the same path, as Drake's page wants it, a WebSocket with the scene.

    Meshcat's messages are handed on to the page. What the page says ends here: Meshcat must not
    hear it, since what it cannot read ends its thread.
    """

    def initialize(self, source):
        self._source = source

    async def get(self, *args, **kwargs):
        if self.request.headers.get("Upgrade", "").lower() == "websocket":
            await super().get(*args, **kwargs)
            return
        try:
            html = (await _fetch(self._source, "")).body.decode()
            self.finish(self._source.make_page(html))
        except KeyError:
            self.set_header("Refresh", "1")
            self.finish("The race is being prepared.")

    def open(self, *args, **kwargs):
        self._task = asyncio.ensure_future(self._hand_on())  # it lives as long as it is kept

    def on_message(self, message):
        pass

    def on_close(self):
        self._task.cancel()

    async def _hand_on(self):
        """Hands on what Meshcat says, until one side closes."""
        meshcat = None
        try:
            meshcat = await tornado.websocket.websocket_connect(
                f"ws://{self._source.meshcat}", max_message_size=_SCENE
            )
            while (message := await meshcat.read_message()) is not None:
                await self.write_message(message, binary=isinstance(message, bytes))
        except _GONE:
            pass
        finally:
            if meshcat is not None:
                meshcat.close()
            self.close()


async def _fetch(source, path):
    client = tornado.httpclient.AsyncHTTPClient()
    try:
        return await client.fetch(f"http://{source.meshcat}/{path}")
    except _GONE:
        raise tornado.web.HTTPError(404) from None


class _MeshcatHandler(Handler):
    """Files that Meshcat's page asks for."""

    def initialize(self, source):
        self._source = source

    async def get(self, path):
        answer = await _fetch(self._source, path)
        self.set_header("Content-Type", answer.headers.get("Content-Type", "text/plain"))
        self.finish(answer.body)


class _FileHandler(Handler):
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


class _RaceSocket(SocketHandler):
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
        except (ValueError, RecursionError):
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
        except _GONE:
            pass
