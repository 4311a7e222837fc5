import threading
import types

import pytest

from airrace.scenario import Scenario
from airrace.track import load_track
from airrace.vehicle import load_vehicle
from airrace.visualization.live_page import LivePage
from airrace.visualization.page_html import LIVE, page_config


@pytest.fixture(scope="module")
def page():
    track = load_track("student-airrace")
    with LivePage(track) as page:
        begin(page, track)
        yield page


def begin(page, track):
    vehicle, _ = load_vehicle("Default")
    page.begin(page_config(Scenario(), track, vehicle, "visualizer/drone/body", mode=LIVE))


def test_the_replay_is_the_record_without_a_server(page):
    page.record.add("events", 1.0, text="something")
    html = page.replay()
    assert '"mode":"replay"' in html and "something" in html and "localhost:" not in html
    assert '"links":[["race.json","race.json"]]' in html


def test_the_replay_links_to_a_report_if_there_will_be_one():
    track = load_track("student-airrace")
    with LivePage(track, report=True) as page:
        begin(page, track)
        assert '"links":[["report","report.html"],["race.json","race.json"]]' in page.replay()


@pytest.fixture
def watched(page, monkeypatch):
    """Says how many pages are connected, and lets no time pass."""
    now = types.SimpleNamespace(pages=1, time=0.0)
    monkeypatch.setattr(LivePage, "watching", property(lambda self: now.pages))
    clock = types.SimpleNamespace(monotonic=lambda: now.time, sleep=lambda s: now.sleep(s))
    monkeypatch.setattr("airrace.visualization.live_page.time", clock)

    def sleep(seconds):
        now.time += seconds

    now.sleep = sleep
    return now


def test_without_a_page_the_program_ends_at_once(page, watched, tmp_path):
    watched.pages = 0
    page.linger(tmp_path, None, lambda line: pytest.fail("it stays"))
    assert watched.time == 0.0


def test_it_does_not_stay_if_not_wanted(page, watched, tmp_path):
    page.linger(tmp_path, 0.0, lambda line: pytest.fail("it stays"))
    assert watched.time == 0.0


def test_it_stays_as_long_as_was_said(page, watched, tmp_path):
    lines = []
    page.linger(tmp_path, 60.0, lines.append)
    assert watched.time == pytest.approx(60.0, abs=0.5)
    assert lines == [f"The page stays at {page.url}; Ctrl-C ends it."]


def test_it_stays_until_the_page_is_closed_but_not_while_it_is_loaded_again(
    page, watched, tmp_path
):
    def sleep(seconds):
        watched.time += seconds
        watched.pages = 0 if 10.0 < watched.time < 12.0 or watched.time > 100.0 else 1

    watched.sleep = sleep
    page.linger(tmp_path, None, lambda line: None)
    assert watched.time == pytest.approx(103.0, abs=0.5)


def test_ctrl_c_ends_it(page, watched, tmp_path):
    def sleep(seconds):
        raise KeyboardInterrupt

    watched.sleep = sleep
    page.linger(tmp_path, None, lambda line: None)


def test_its_server_ends_with_it():
    before = set(threading.enumerate())
    with LivePage(load_track("student-airrace")):
        assert set(threading.enumerate()) > before
    assert set(threading.enumerate()) <= before
