import logging
import re
import types

import numpy as np
import pytest

from airrace.common.errors import UserError
from airrace.track import load_track
from airrace.visualization import meshcat_page
from airrace.visualization.meshcat_page import Audience, HiddenMeshcat, overview


def test_serves_on_loopback_only_and_where_nobody_looks(meshcat):
    addresses = {meshcat.web_url(), HiddenMeshcat().web_url()}
    assert len(addresses) == 2
    for address in addresses:
        host, port = re.match(r"http://(127\.\d+\.\d+\.\d+):(\d+)$", address).groups()
        assert host != "127.0.0.1" and not 7000 <= int(port) < 8000


def test_a_computer_with_one_address_of_loopback_has_a_page(monkeypatch):
    made = meshcat_page.Meshcat

    def only_here(params):
        if params.host != "127.0.0.1":
            raise RuntimeError("Failed to listen.")
        return made(params)

    monkeypatch.setattr(meshcat_page, "Meshcat", only_here)
    assert HiddenMeshcat().web_url().startswith("http://127.0.0.1:")
    monkeypatch.setattr(meshcat_page, "_LOOPBACK", "127.0.0.2")
    with pytest.raises(UserError, match="Failed to listen"):
        HiddenMeshcat()


def test_overview_looks_down_at_the_middle_of_the_track():
    track = load_track("student-airrace")
    eye, middle = overview(track)
    np.testing.assert_allclose(middle, track.pylons().mean(axis=0))
    assert eye[2] > 10.0


@pytest.fixture
def clock(monkeypatch):
    """A clock that the test sets."""
    clock = types.SimpleNamespace(now=100.0)
    monkeypatch.setattr(meshcat_page.time, "perf_counter", lambda: clock.now)
    return clock


def test_audience_waits_once_a_period(clock):
    server = types.SimpleNamespace(GetNumActiveConnections=lambda: 1)
    audience = Audience(server, period=0.25)
    assert not audience.waits()  # the page opens
    clock.now += 10.0
    assert audience.waits()
    assert not audience.waits()
    clock.now += 0.2
    assert not audience.waits()
    clock.now += 0.1
    assert audience.waits()


def test_nobody_waits_where_nobody_is(clock):
    audience = Audience(types.SimpleNamespace(GetNumActiveConnections=lambda: 0), period=0.25)
    for _ in range(3):
        assert not audience.waits()
        clock.now += 10.0


def test_a_page_that_opens_is_left_alone_for_a_while(clock):
    server = types.SimpleNamespace(count=1, GetNumActiveConnections=lambda: server.count)
    audience = Audience(server, period=0.25)
    audience.waits()
    clock.now += 5.0
    assert audience.waits()
    server.count = 2
    clock.now += 1.0
    assert not audience.waits()
    clock.now += 1.0
    assert not audience.waits()
    clock.now += 3.0
    assert audience.waits()


def test_a_page_that_is_late_is_nothing_to_warn_of(meshcat, caplog):
    drake = logging.getLogger("drake")
    with caplog.at_level(logging.WARNING, "drake"):
        drake.warning("Meshcat: Unknown CAS key 123 (there are 5 assets in the cache)")
        drake.warning("something else")
    assert [record.getMessage() for record in caplog.records] == ["something else"]
