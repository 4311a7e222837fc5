"""The pages as people see them: the live view, the replays and the report, in a browser."""

import re
import subprocess
import sys
import threading
import time

import cv2
import numpy as np
import pytest

from airrace.commands.app import main as airrace
from airrace.visualization.controls import PAUSE, SPEED
from airrace.visualization.views import BUTTONS, CHASE, ONBOARD, OVERVIEW
from tests.visualization.browser import CHROMIUM, Browser
from tests.worlds.made_up_run import make_run

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium to look with")
DRONE, GHOST = "drake/visualizer/drone/body", "drake/visualizer/run_0/body"
TOOLS = """
var node = path => path.split("/").reduce(
  (node, name) => node && node.children[name], viewer.scene_tree);
var place = object => new MeshCat.THREE.Vector3().setFromMatrixPosition(object.matrixWorld);
var meshes = path => { let count = 0; node(path)?.object.traverse(
  each => count += each.isMesh === true); return count; };
var control = name => [...document.querySelectorAll("li.cr")].find(
  each => each.querySelector(".property-name")?.textContent === name);
"""


@pytest.fixture(scope="module")
def browser():
    with Browser() as browser:
        yield browser


class LiveRace:
    """A race in a process of its own, in real time, until it is stopped.

    Attributes:
        url: of its page.
        folder: of its results.
        events: pairs of when it said something (s) and of what simulated time (s).
    """

    def __init__(self, track, folder):
        self.folder, self.url, self.events, self._said = folder, None, [], []
        self._process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "airrace",
                "race",
                "--track",
                track,
                "--laps",
                "9",
                "--output",
                str(folder),
                "--realtime_rate",
                "1",
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self):
        for line in self._process.stdout:
            self._said.append(line)
            if line.startswith("Watch it at "):
                self.url = line.split()[-1]
            if event := re.match(r"\[ *([0-9.]+) s\]", line):
                self.events.append((time.monotonic(), float(event[1])))

    def stop(self):
        self._process.terminate()
        assert self._process.wait(60.0) in (0, 1), "".join(self._said)


@pytest.fixture(scope="module")
def race(hexagon, tmp_path_factory):  # noqa: F811
    race = LiveRace(hexagon, tmp_path_factory.mktemp("races") / "race")
    try:
        until(lambda: race.events, patience=300.0)  # it may have to compile
        yield race
    finally:
        race.stop()


@pytest.fixture(scope="module")
def folder(race):
    """Of the race, when it is over."""
    race.stop()
    return race.folder


def look(browser, name):
    """Returns what is seen, which is kept on disk, and is more than a background."""
    picture = browser.screenshot()
    assert picture.std() > 10.0
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 100
    if name:
        cv2.imwrite(str(name), picture)
    return picture


def distance(browser):
    """Returns that from the page's camera to the drone (m)."""
    return browser.evaluate(f"place(viewer.camera).distanceTo(place(node('{DRONE}').object))")


def until(condition, patience=60.0):
    deadline = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.mark.slow
def test_live_view(browser, race, tmp_path):
    browser.open(race.url)
    browser.evaluate(TOOLS)
    browser.wait_for("viewer.connection?.readyState === WebSocket.OPEN")
    browser.wait_for(f"meshes('{DRONE}') > 5 && meshes('drake/visualizer') > 50")
    browser.wait_for("meshes('drake/flown') > 0")
    views = {}
    for view, near, far in ((CHASE, 3.0, 8.0), (ONBOARD, 0.0, 1.5), (OVERVIEW, 15.0, 90.0)):
        browser.evaluate(f"control('{BUTTONS[view][0]}').click()")
        until(lambda: near <= distance(browser) < far)  # noqa: B023
        views[view] = look(browser, tmp_path / f"{view}.png").astype(float)
    for one, other in ((CHASE, ONBOARD), (CHASE, OVERVIEW), (ONBOARD, OVERVIEW)):
        assert np.abs(views[one] - views[other]).mean() > 5.0
    assert browser.errors == []


@pytest.mark.slow
def test_pause_and_speed(browser, race):
    browser.open(race.url)
    browser.evaluate(TOOLS)
    browser.wait_for(f"!!(control('{PAUSE}') && control('{SPEED}'))")
    browser.wait_for(f"meshes('{DRONE}') > 5")
    browser.evaluate(f"control('{PAUSE}').click()")
    until(lambda: seconds_way(browser) == 0.0)
    browser.evaluate(f"control('{PAUSE}').click()")
    until(lambda: seconds_way(browser) > 0.1)
    set_number(browser, SPEED, 0.5)
    time.sleep(0.5)
    first = len(race.events)
    until(lambda: len(race.events) >= first + 2)
    (start, sim_start), (end, sim_end) = race.events[first], race.events[-1]
    assert 0.3 < (sim_end - sim_start) / (end - start) < 0.7
    assert browser.errors == []


def set_number(browser, name, value):
    """Types a number into the field beside a slider."""
    browser.evaluate(f"""{{
        const input = control('{name}').querySelector("input");
        input.value = "{value}";
        input.dispatchEvent(new Event("change"));
    }}""")


def seconds_way(browser):
    """Returns how far the drone goes on the page in a second (m)."""
    return browser.evaluate(f"""new Promise(done => {{
        const start = place(node('{DRONE}').object);
        setTimeout(() => done(start.distanceTo(place(node('{DRONE}').object))), 1000);
    }})""")


def moves(browser, path, least, act):
    """Waits until what is drawn at a path is some way (m) from where it was before act()."""
    there = f"place(node('{path}').object)"
    start = browser.evaluate(f"{there}.toArray()")
    act()
    browser.wait_for(f"{there}.distanceTo(new MeshCat.THREE.Vector3(...{start})) > {least}")


def open_offline(browser, page):
    browser.open(page.as_uri())
    assert page.as_uri() in browser.requests
    assert {url.partition(":")[0] for url in browser.requests} <= {"file", "data", "blob"}


@pytest.mark.slow
def test_race_html(browser, folder, tmp_path):
    open_offline(browser, folder / "race.html")
    browser.evaluate(TOOLS)
    browser.wait_for(f"meshes('{DRONE}') > 5 && meshes('drake/visualizer') > 50")
    look(browser, tmp_path / "race.png")
    moves(browser, DRONE, 1.0, lambda: browser.evaluate("control('play').click()"))
    assert browser.errors == []


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 2])
def test_replay(browser, count, tmp_path):
    folders = [tmp_path / f"run{k}" for k in range(count)]
    for k, folder in enumerate(folders):
        make_run(folder, laps=k + 1)
    page = tmp_path / "replay.html"
    assert airrace(["replay", *map(str, folders), "--html", str(page)]) == 0
    open_offline(browser, page)
    browser.evaluate(TOOLS)
    browser.wait_for(
        f"[...Array({count}).keys()].every(k => meshes(`drake/visualizer/run_${{k}}/body`) > 0)"
    )
    look(browser, tmp_path / "replay.png")
    moves(browser, GHOST, 1.0, lambda: browser.evaluate("control('play').click()"))
    assert browser.errors == []


@pytest.mark.slow
def test_replay_that_is_served(browser, tmp_path):
    make_run(tmp_path / "run", laps=2)
    with subprocess.Popen(
        [sys.executable, "-u", "-m", "airrace", "replay", str(tmp_path / "run")],
        stdout=subprocess.PIPE,
        text=True,
    ) as program:
        try:
            line = next(line for line in program.stdout if line.startswith("Watch it at "))
            browser.open(line.split()[3].rstrip(";"))
            browser.evaluate(TOOLS)
            browser.wait_for(f"meshes('{GHOST}') > 0 && !!control('time')")
            set_number(browser, "time", 0.5)
            look(browser, None)
            moves(browser, GHOST, 10.0, lambda: set_number(browser, "time", 3.0))
            look(browser, tmp_path / "replay.png")
        finally:
            program.terminate()
    assert browser.errors == []


@pytest.mark.slow
def test_report_html(browser, folder, tmp_path):
    open_offline(browser, folder / "report.html")
    look(browser, tmp_path / "report.png")
    assert (
        browser.evaluate(
            "[...document.querySelectorAll('svg')].filter("
            "each => each.getBoundingClientRect().height > 50).length"
        )
        >= 3
    )
    assert browser.errors == []
