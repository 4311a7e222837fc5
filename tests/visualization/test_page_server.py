import asyncio
import json
import re
import time
import types
import urllib.error
import urllib.request
from pathlib import Path

import pytest
import tornado.httpclient
import tornado.websocket

from airrace.common.errors import UserError
from airrace.visualization import loopback_server
from airrace.visualization.controls import PaceRequest
from airrace.visualization.page_server import PageServer, Source
from airrace.visualization.race_record import EVENTS, RaceRecord


@pytest.fixture
def world(meshcat):
    """A server, and what it serves."""
    record, pace = RaceRecord(), PaceRequest()
    source = Source(
        lambda html: html + "<!-- ours -->", meshcat.web_url().removeprefix("http://"), record, pace
    )
    server = PageServer(source)
    yield types.SimpleNamespace(server=server, record=record, pace=pace, url=server.url)
    server.close()


def get(url):
    with urllib.request.urlopen(url, timeout=10) as answer:
        return answer.read().decode(errors="replace")


def talk(world, conversation, path="/race", origin=None):
    """Runs a conversation, a coroutine of a connected WebSocket, and returns what it returns."""

    async def run():
        url = world.url.replace("http", "ws") + path
        headers = {"Origin": origin or world.url}
        request = tornado.httpclient.HTTPRequest(url, headers=headers)
        socket = await tornado.websocket.websocket_connect(request)
        try:
            return await asyncio.wait_for(conversation(socket), 20)
        finally:
            socket.close()
            while await asyncio.wait_for(socket.read_message(), 5) is not None:  # until it is
                pass

    return asyncio.run(run())


async def batch_with(socket, key):
    while True:
        batch = json.loads(await socket.read_message())
        if key in batch:
            return batch


def test_serves_on_loopback_only(world):
    """As Linux's tables of connections have it; there, 0A is who listens."""
    port = f"{int(world.url.rpartition(':')[2]):04X}"
    rows = [
        line.split()[1:4:2]
        for table in ("/proc/net/tcp", "/proc/net/tcp6")
        for line in Path(table).read_text().splitlines()[1:]
    ]
    listening = {address for address, state in rows if state == "0A" and address.endswith(port)}
    loopback = {f"0100007F:{port}", f"00000000000000000000000001000000:{port}"}
    assert listening and listening <= loopback


def test_the_page_is_meshcats_with_ours(world):
    page = get(world.url)
    assert "MeshCat.Viewer" in page and page.endswith("<!-- ours -->")
    (script,) = re.findall(r'<script[^>]* src="(.*?)"', page)
    assert "MeshCat" in get(f"{world.url}/{script}")


def test_a_page_gets_what_was_and_what_comes(world):
    world.record.add(EVENTS, 1.0, text="before")

    async def conversation(socket):
        first = await batch_with(socket, EVENTS)
        world.record.add(EVENTS, 2.0, text="after")
        return first[EVENTS] + (await batch_with(socket, EVENTS))[EVENTS]

    assert [event["text"] for event in talk(world, conversation)] == ["before", "after"]


def test_a_request_comes_back_to_all_pages(world):
    world.pace.begin(1.0)

    async def conversation(socket):
        before = await batch_with(socket, "controls")
        await socket.write_message("no JSON")
        await socket.write_message(json.dumps({"rate": 0.5, "pause": True}))
        return before["controls"], (await batch_with(socket, "controls"))["controls"]

    before, after = talk(world, conversation)
    assert before == {"paused": False, "rate": 1.0} and after == {"paused": True, "rate": 0.5}


@pytest.mark.parametrize("path", ["/race", "/"])
def test_pages_from_elsewhere_are_refused(world, path):
    async def nothing(socket):
        pass

    with pytest.raises(tornado.httpclient.HTTPClientError, match="403"):
        talk(world, nothing, path, origin="http://example.com")


def test_meshcats_own_messages_come_through(world, meshcat):
    meshcat.SetProperty("a_path_of_ours", "visible", False)

    async def conversation(socket):
        while b"a_path_of_ours" not in (message := await socket.read_message()):
            pass
        return message

    assert b"set_property" in talk(world, conversation, "/")
    deadline = time.monotonic() + 10  # it notices that the page has gone
    while meshcat.GetNumActiveConnections() > 0:
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.mark.parametrize("message", [b"\xde", b"\xdd\xff\xff\xff\xff", b'\x81\xa4"type"', "text"])
def test_nothing_that_a_page_says_reaches_meshcat(world, meshcat, message):
    meshcat.SetProperty("a_path_of_ours", "visible", False)

    async def conversation(socket):
        await socket.write_message(message, binary=isinstance(message, bytes))
        while b"a_path_of_ours" not in await socket.read_message():
            pass
        await asyncio.sleep(0.1)  # in which it would end

    talk(world, conversation, "/")
    assert meshcat.GetNumActiveConnections() >= 0  # raises if it has ended


@pytest.mark.parametrize("message", ["[" * 4000, '{"rate": 1e999}', '{"pause": 1}', b"\xff\xfe"])
def test_what_makes_no_sense_is_left_out(world, message):
    world.pace.begin(1.0)

    async def conversation(socket):
        await socket.write_message(message, binary=isinstance(message, bytes))
        await socket.write_message('{"rate": 0.25}')
        while (await batch_with(socket, "controls"))["controls"]["rate"] != 0.25:
            pass

    talk(world, conversation)
    assert world.pace.now == (False, 0.25)


def test_only_results_are_served_and_only_after_the_race(world, tmp_path):
    (tmp_path / "race.json").write_text("{}")
    (tmp_path / "secret").write_text("secret")
    with pytest.raises(urllib.error.HTTPError, match="404"):
        get(f"{world.url}/race.json")
    world.server.show_results(tmp_path)
    assert get(f"{world.url}/race.json") == "{}"
    for name in ("secret", "report.html", "../secret", "%2e%2e/secret"):
        with pytest.raises(urllib.error.HTTPError, match="404"):
            get(f"{world.url}/{name}")

    async def conversation(socket):
        return (await batch_with(socket, "links"))["links"]

    assert talk(world, conversation) == [["race.json", "race.json"]]


def test_who_does_not_read_keeps_nobody_waiting(world):
    """The race adds to the record, whatever a page does."""

    async def conversation(socket):
        start = time.perf_counter()
        for k in range(20):
            world.record.add(EVENTS, float(k), text="x" * 500_000)
            await asyncio.sleep(0.04)
        return time.perf_counter() - start

    assert talk(world, conversation) < 5.0


def test_two_servers_have_two_ports(world, meshcat):
    other = PageServer(
        Source(str, meshcat.web_url().removeprefix("http://"), RaceRecord(), PaceRequest())
    )
    assert other.url != world.url
    other.close()
    other.close()  # may be called again


def test_no_port_is_free(world, monkeypatch):
    port = int(world.url.rpartition(":")[2])
    monkeypatch.setattr(loopback_server, "_PORTS", range(port, port + 1))
    with pytest.raises(UserError, match="are taken; close another program"):
        PageServer(Source(str, "127.0.0.1:1", RaceRecord(), PaceRequest()))
