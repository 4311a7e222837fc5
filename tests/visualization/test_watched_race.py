"""The live view of a whole race."""

import asyncio
import json
import subprocess
import sys
import time

import pytest
import tornado.websocket

from airrace.diagrams.race import run_race
from airrace.scenario import load_scenario
from airrace.track import load_track
from airrace.visualization import meshcat_page
from airrace.visualization.live_page import LivePage
from tests.worlds.cases import first


class _Watched(meshcat_page.Audience):
    """An audience that always looks."""

    def waits(self):
        return True


@pytest.fixture
def run(tmp_path, hexagon, monkeypatch):
    """Flies the beginning of a race, in which the first gate is found."""
    monkeypatch.setattr("airrace.visualization.live_page.Audience", _Watched)

    def run(name, page=None, text="{}", time_limit=6.0, sinks=()):
        scenario = load_scenario(scenario_text=text)
        scenario.track = hexagon
        scenario.camera.width, scenario.camera.height = 640, 360
        scenario.referee.time_limit = time_limit
        folder = tmp_path / name
        folder.mkdir()
        run_race(scenario, folder, page=page, sinks=sinks)
        return folder

    return run


@pytest.mark.slow
@pytest.mark.parametrize("text", first(["{disturbances: {gate_shift: 1.0}, drone: StarOne}", "{}"]))
def test_a_race_that_is_watched_is_the_same_race(run, hexagon, text):
    with LivePage(load_track(hexagon)) as page:
        folders = [run("alone", text=text), run("watched", page, text)]
        assert page.meshcat.HasPath("visualizer/drone/body")
    results = [json.loads((folder / "race.json").read_text()) for folder in folders]
    for result in results:
        del result["wall"]
    assert results[0] == results[1]
    assert (folders[0] / "map.json").read_bytes() == (folders[1] / "map.json").read_bytes()
    told = page.record.whole()
    assert {"frames", "status", "events", "maps", "over"} <= set(told)
    assert ("shifts" in told) == ("gate_shift" in text)
    assert len(told["pictures"]) > 25
    assert all(len(picture["markers"]) > 1 for picture in told["pictures"])
    assert told["over"]["finished"] is False and "time" in told["over"]["reason"]
    assert '"mode":"replay"' in (folders[1] / "race.html").read_text()


def kill(meshcat):
    """Sends a Meshcat what it cannot read, past the page's server, and waits for its end."""

    async def send():
        url = meshcat.web_url().replace("http", "ws")
        socket = await tornado.websocket.websocket_connect(url)
        await socket.write_message(b"\xde", binary=True)
        while await socket.read_message() is not None:
            pass

    asyncio.run(send())
    with pytest.raises(RuntimeError, match="exited unexpectedly"):  # it takes a moment
        for _ in range(1000):
            meshcat.GetNumActiveConnections()
            time.sleep(0.01)


def test_a_race_outlives_its_page(run, hexagon, caplog):
    lines, events = [], []

    def watch(event):
        events.append(event)
        if len(events) == 5:
            kill(page.meshcat)

    with LivePage(load_track(hexagon)) as page:
        page.note = lines.append
        folder = run("watched", page, "{recording: {content: none}}", time_limit=1.5, sinks=[watch])
    assert len(lines) == 1, lines
    assert lines[0].startswith("The page is gone (Meshcat's internal websocket"), lines
    assert not [record for record in caplog.records if record.name == "drake"]
    assert json.loads((folder / "race.json").read_text())["dnf_reason"].startswith(
        "ran out of time"
    )
    assert not (folder / "race.html").exists()


PROGRAM = """
import gc
from airrace.track import load_track
from airrace.visualization.live_page import LivePage
from tests.visualization.test_watched_race import kill
page = LivePage(load_track("hexagon"))
kill(page.meshcat)
page.close()
del page
gc.collect()
print("goes on")
"""


def test_a_program_outlives_its_dead_page():
    """To destroy such a Meshcat aborts a process, or never ends."""
    command = [sys.executable, "-c", PROGRAM]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0 and done.stdout == "goes on\n"
