"""A web server that hands all below a path of its own on, as Jupyter's and Codespaces' do."""

import asyncio
import threading

import tornado.httpclient
import tornado.httpserver
import tornado.netutil
import tornado.web
import tornado.websocket

PREFIX = "/user/someone/proxy/7100"
_SAME = ("Content-Type", "Host", "Origin")  # headers that are handed on as they are


class PrefixProxy:
    """Serves what another server on loopback does, below PREFIX; a context manager.

    Attributes:
        url: of what the other one serves as "/".
    """

    def __init__(self, target):
        """Args: target: the other's address, such as http://localhost:7100."""
        self._target, self._ready = target.replace("http://", ""), threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()), daemon=True)

    def __enter__(self):
        self._thread.start()
        assert self._ready.wait(10.0)
        return self

    def __exit__(self, *_):
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(10.0)

    async def _serve(self):
        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        rules = [(rf"{PREFIX}(/.*)", _Handler, {"target": self._target})]
        server = tornado.httpserver.HTTPServer(tornado.web.Application(rules))
        (socket, *_) = tornado.netutil.bind_sockets(0, "127.0.0.1")
        server.add_socket(socket)
        self.url = f"http://localhost:{socket.getsockname()[1]}{PREFIX}/"
        self._ready.set()
        await self._stop.wait()
        server.stop()
        await server.close_all_connections()


class _Handler(tornado.websocket.WebSocketHandler):
    def initialize(self, target):
        self._target, self._other = target, None

    def check_origin(self, origin):
        return True

    def _request(self, scheme, path):
        headers = {name: v for name in _SAME if (v := self.request.headers.get(name))}
        return tornado.httpclient.HTTPRequest(f"{scheme}://{self._target}{path}", headers=headers)

    async def get(self, path):
        if self.request.headers.get("Upgrade", "").lower() == "websocket":
            return await super().get(path)
        answer = await tornado.httpclient.AsyncHTTPClient().fetch(
            self._request("http", path), raise_error=False
        )
        self.set_status(answer.code)
        self.set_header("Content-Type", answer.headers.get("Content-Type", "text/html"))
        self.finish(answer.body)

    async def open(self, path):
        self._other = await tornado.websocket.websocket_connect(
            self._request("ws", path), max_message_size=1 << 28
        )
        self._task = asyncio.ensure_future(self._hand_on())

    async def _hand_on(self):
        try:
            while (message := await self._other.read_message()) is not None:
                await self.write_message(message, binary=isinstance(message, bytes))
        except tornado.websocket.WebSocketClosedError:
            pass
        self.close()

    def on_message(self, message):
        self._other.write_message(message, binary=isinstance(message, bytes))

    def on_close(self):
        if self._other is not None:
            self._other.close()
