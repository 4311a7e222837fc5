"""The live page through a proxy that puts it below a path of its own, such as Jupyter's."""

import asyncio
import urllib.error
import urllib.request

import pytest
import tornado.httpclient
import tornado.websocket

from airrace.scenario import Scenario
from airrace.track import load_track
from airrace.vehicle import load_vehicle
from airrace.visualization.live_page import LivePage
from airrace.visualization.page_html import LIVE, page_config
from tests.visualization.browser import CHROMIUM, Browser
from tests.worlds.prefix_proxy import PrefixProxy

HUB = "https://hub.example.org"


def live_page(allow_origin=()):
    track = load_track("student-airrace")
    page = LivePage(track, allow_origin=allow_origin)
    page.meshcat.SetTransform("somewhere", [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    vehicle, _ = load_vehicle("Default")
    page.begin(page_config(Scenario(), track, vehicle, "visualizer/drone/body", mode=LIVE))
    page.record.add("events", 1.0, text="something")
    return page


@pytest.mark.parametrize("path", ["race", ""])
@pytest.mark.parametrize("allowed", [(HUB,), ()])
def test_both_its_streams_come_through_one_port_and_a_hubs_name(allowed, path):
    headers = {"Host": "hub.example.org", "Origin": HUB}

    async def first_message(url):
        request = tornado.httpclient.HTTPRequest(url.replace("http", "ws") + path, headers=headers)
        socket = await tornado.websocket.websocket_connect(request, max_message_size=1 << 28)
        try:
            return await asyncio.wait_for(socket.read_message(), 10.0)
        finally:
            socket.close()

    with live_page(allowed) as page, PrefixProxy(page.url) as proxy:
        request = urllib.request.Request(proxy.url, headers=headers)
        if not allowed:
            with pytest.raises(urllib.error.HTTPError, match="403"):
                urllib.request.urlopen(request)
            assert not asyncio.run(first_message(proxy.url))
            return
        with urllib.request.urlopen(request) as answer:
            assert b"MeshCat" in answer.read()
        assert asyncio.run(first_message(proxy.url))


@pytest.mark.browser
@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium to look with")
def test_nothing_of_it_asks_above_its_path():
    with live_page() as page, PrefixProxy(page.url) as proxy, Browser(slowly=True) as browser:
        browser.open(proxy.url)
        browser.wait_for("!!window.airrace && airrace.timeline.count >= 0")
        browser.wait_for("airrace.feed.open && viewer.connection?.readyState === WebSocket.OPEN")
        asked = [url for url in browser.requests if url.startswith(("http", "ws"))]
        # Browsers ask for an icon at the top themselves.
        asked = [url for url in asked if not url.endswith("/favicon.ico")]
        assert asked and all(url.partition("://")[2].startswith(proxy.url[7:]) for url in asked)
        assert [error for error in browser.errors if "favicon" not in error] == []
        browser.open("about:blank")  # a scene is drawn as long as it is there
