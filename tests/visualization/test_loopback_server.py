import http.client
import json
import socket
import time
import types

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from airrace.common.errors import UserError
from airrace.visualization import loopback_server
from airrace.visualization.controls import PaceRequest
from airrace.visualization.loopback_server import MOST_CONNECTIONS, Visitors
from airrace.visualization.page_server import PageServer, Source
from airrace.visualization.race_record import RaceRecord

HUB = "https://hub.example.org"


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """A server of a race that has ended, without a Meshcat, and its port."""
    folder = tmp_path_factory.mktemp("results")
    (folder / "race.json").write_text("{}")
    source = Source(str, "127.0.0.1:9", RaceRecord(), PaceRequest(), Visitors([HUB]))
    server = PageServer(source)
    server.show_results(folder)
    yield types.SimpleNamespace(port=int(server.url.rpartition(":")[2]))
    server.close()


def ask(port, host=None, origin=None, path="/race.json", method="GET"):
    """Returns the status of an answer, and its text."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    headers = {"Host": host or f"localhost:{port}", **({"Origin": origin} if origin else {})}
    connection.request(method, path, headers=headers)
    answer = connection.getresponse()
    text = answer.read().decode()
    connection.close()
    return answer.status, text


def lives(port):
    return ask(port) == (200, "{}")


@pytest.mark.parametrize(
    ("host", "origin", "may"),
    [
        ("localhost:7100", None, True),
        ("127.0.0.1:7100", "http://127.0.0.1:7100", True),
        ("[::1]:7100", None, True),
        ("LOCALHOST:8080", "http://localhost:8080", True),  # through ssh -L
        ("localhost:7100", "http://localhost:3000", False),  # another program's page
        ("localhost:7100", "null", False),
        ("localhost:7100", "http://evil.example", False),
        ("evil.example:7100", "http://evil.example:7100", False),  # DNS rebinding
        ("evil.example", None, False),
        ("", None, False),
        ("hub.example.org", HUB, True),
        ("hub.example.org:443", HUB, True),
        ("localhost:7100", HUB, True),  # a proxy that keeps only Origin
        ("hub.example.org", "https://evil.example", False),
        ("localhost:7100", "http://hub.example.org", False),
    ],
)
def test_who_may_ask(host, origin, may):
    assert Visitors([HUB + "/"]).may_ask(host, origin) is may


@pytest.mark.parametrize("text", ["*", "hub.example.org", "https://", "ftp://a", "https://*.a.dev"])
def test_what_is_no_origin_is_refused(text):
    with pytest.raises(UserError, match="--allow_origin .*: give what the browser's address"):
        Visitors([text])


def test_every_path_is_for_visitors_only(server):
    for path in ("/", "/race", "/race.json", "/favicon.ico", "/cas-v1/a", "/nothing"):
        assert ask(server.port, host="evil.example", path=path)[0] == 403
        assert ask(server.port, origin="http://evil.example", path=path)[0] == 403
    assert "--allow_origin" in ask(server.port, host="hub.example.net")[1]
    assert ask(server.port, host="hub.example.org", origin=HUB) == (200, "{}")
    assert ask(server.port, method="POST")[0] == 405


def test_more_connections_than_pages_need_are_closed(server):
    mute = [socket.create_connection(("127.0.0.1", server.port)) for _ in range(200)]
    time.sleep(0.3)
    closed = 0
    for each in mute:
        each.setblocking(False)
        try:
            closed += each.recv(1) == b""
        except BlockingIOError:
            pass
    assert closed == 200 - MOST_CONNECTIONS
    for each in mute:
        each.close()
    time.sleep(0.2)
    assert lives(server.port)


def test_a_body_without_an_end_is_not_taken(server):
    with socket.create_connection(("127.0.0.1", server.port), timeout=10) as sender:
        sender.sendall(
            f"POST /race HTTP/1.1\r\nHost: localhost:{server.port}\r\n"
            "Content-Length: 100000000\r\n\r\n".encode()
        )
        taken = 0
        with pytest.raises(OSError):
            while taken < 1 << 26:
                taken += sender.send(bytes(1 << 16))
    assert taken < 1 << 24  # what waits in the sockets' buffers
    assert lives(server.port)


def test_who_says_nothing_is_closed(monkeypatch):
    monkeypatch.setattr(loopback_server, "_IDLE", 0.2)
    idle = PageServer(Source(str, "127.0.0.1:9", RaceRecord(), PaceRequest()))
    address = "127.0.0.1", int(idle.url.rpartition(":")[2])
    with socket.create_connection(address, timeout=10) as sender:
        assert sender.recv(1) == b""
    idle.close()


_HEADS = st.sampled_from(
    [b"GET / HTTP/1.1\r\n", b"GET /race HTTP/1.1\r\n", b"POST /race HTTP/1.1\r\n", b""]
)
_LINES = st.sampled_from(
    [
        b"Host: localhost\r\n",
        b"Upgrade: websocket\r\n",
        b"Connection: Upgrade\r\n",
        b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n",
        b"Sec-WebSocket-Version: 13\r\n",
        b"Content-Length: 10\r\n",
        b"Transfer-Encoding: chunked\r\n",
        b"Expect: 100-continue\r\n",
    ]
)


@settings(max_examples=60, suppress_health_check=list(HealthCheck))
@given(head=_HEADS, lines=st.lists(_LINES, max_size=8), rest=st.binary(max_size=300))
def test_whatever_bytes_come_it_goes_on(server, capfd, caplog, head, lines, rest):
    with socket.create_connection(("127.0.0.1", server.port), timeout=10) as sender:
        sender.sendall(head + b"".join(lines) + b"\r\n" + rest)
        sender.setblocking(False)
    assert lives(server.port)
    assert capfd.readouterr() == ("", "") and not caplog.records


@pytest.mark.parametrize(
    ("kind", "body"),
    [
        ("multipart/form-data; boundary=x", b"no parts"),
        ("multipart/form-data", b"no boundary"),
        ("application/x-www-form-urlencoded", b"\xff=%ff"),
    ],
)
def test_bad_forms_are_nothing_to_tell_at_the_terminal(server, capfd, caplog, kind, body):
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
    connection.request("POST", "/race", body, {"Content-Type": kind, "Host": "localhost"})
    assert connection.getresponse().status in (400, 405)
    connection.close()
    assert capfd.readouterr() == ("", "") and not caplog.records


_UPGRADE = (
    b"GET /race HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
)
_JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(["pause", "rate", "x"]), inner, max_size=3)
    ),
)


@settings(max_examples=30, suppress_health_check=list(HealthCheck))
@given(payload=st.binary(max_size=100) | _JSON.map(lambda data: json.dumps(data).encode()),
       first=st.integers(0, 255), masked=st.booleans())  # fmt: skip
def test_whatever_frames_come_it_goes_on(server, capfd, caplog, payload, first, masked):
    frame = bytes([first, len(payload) % 126 | 128 * masked]) + bytes(4 * masked) + payload
    with socket.create_connection(("127.0.0.1", server.port), timeout=10) as sender:
        sender.sendall(_UPGRADE)
        assert sender.recv(12) == b"HTTP/1.1 101"
        sender.sendall(frame)
    assert lives(server.port)
    assert capfd.readouterr() == ("", "") and not caplog.records
