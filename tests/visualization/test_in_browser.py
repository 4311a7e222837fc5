"""The pages as people see them: the live view, the replays and the report, in a browser."""

import threading
import time

import cv2
import numpy as np
import pytest

from airrace.analysis.report import write_report
from airrace.diagrams.partner import InProcess
from airrace.diagrams.replay import main as replay
from airrace.diagrams.runner import run_race
from airrace.diagrams.scenario import Scenario
from airrace.diagrams.visualization import MakeMeshcat
from airrace.track import load_track
from airrace.visualization.controls import PAUSE, SPEED
from airrace.visualization.views import BUTTONS, CHASE, ONBOARD, OVERVIEW
from tests.analysis.made_up_run import make_run
from tests.browser import CHROMIUM, Browser
from tests.diagrams.conftest import hexagon  # noqa: F401  # a fixture

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium to look with")
DRONE = "drake/visualizer/drone/body"
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


class LiveRace(InProcess, threading.Thread):
    """A race that somebody watches, until it is stopped."""

    def __init__(self, track, folder):
        threading.Thread.__init__(self, daemon=True)
        self.folder, self.url, self.simulator = folder, None, None
        self._scenario, self._stopped = Scenario(track=track, laps=1), threading.Event()
        # For pages on a slow machine to see it.
        self._scenario.simulator_config.target_realtime_rate = 1.0
        self.start()

    def run(self):
        meshcat = MakeMeshcat(load_track(self._scenario.track))  # of this thread alone
        self.url = meshcat.web_url()
        run_race(self._scenario, self.folder, meshcat=meshcat, partner=self)
        write_report(self.folder)

    def advance(self, simulator, time):
        self.simulator = simulator
        if self._stopped.is_set():
            return "nobody watches any more"
        return super().advance(simulator, time)

    def time(self):
        return self.simulator.get_context().get_time()

    def stop(self):
        self._stopped.set()
        self.join(60.0)
        assert not self.is_alive()


@pytest.fixture(scope="module")
def race(hexagon, tmp_path_factory):  # noqa: F811
    race = LiveRace(hexagon, tmp_path_factory.mktemp("race"))
    until(lambda: race.simulator is not None)
    yield race
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


def until(condition, patience=30.0):
    deadline = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


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


def standing_time(race):
    """Returns the simulated time (s) at which the race stands still for a second."""
    while True:
        before = race.time()
        time.sleep(1.0)
        if race.time() == before:
            return before


def test_pause_and_speed(browser, race):
    browser.open(race.url)
    browser.evaluate(TOOLS)
    browser.wait_for(f"!!(control('{PAUSE}') && control('{SPEED}'))")
    browser.evaluate(f"control('{PAUSE}').click()")
    before = standing_time(race)
    browser.evaluate(f"control('{PAUSE}').click()")
    until(lambda: race.time() > before)
    browser.evaluate(f"""{{
        const input = control('{SPEED}').querySelector("input");
        input.value = "0.5";
        input.dispatchEvent(new Event("change"));
    }}""")
    until(lambda: race.simulator.get_target_realtime_rate() == 0.5)
    assert browser.errors == []


def open_offline(browser, page):
    browser.open(page.as_uri())
    assert page.as_uri() in browser.requests
    assert {url.partition(":")[0] for url in browser.requests} <= {"file", "data", "blob"}


def test_race_html(browser, folder, tmp_path):
    open_offline(browser, folder / "race.html")
    browser.evaluate(TOOLS)
    browser.wait_for(f"meshes('{DRONE}') > 5 && meshes('drake/visualizer') > 50")
    look(browser, tmp_path / "race.png")
    start = browser.evaluate(f"place(node('{DRONE}').object).toArray()")
    browser.evaluate("control('play').click()")
    browser.wait_for(f"place(node('{DRONE}').object).distanceTo("
                     f"new MeshCat.THREE.Vector3(...{start})) > 1.0")
    assert browser.errors == []


@pytest.mark.parametrize("count", [1, 2])
def test_replay(browser, count, tmp_path):
    folders = [tmp_path / f"run{k}" for k in range(count)]
    for k, folder in enumerate(folders):
        make_run(folder, laps=k + 1)
    page = tmp_path / "replay.html"
    assert replay([*map(str, folders), "--html", str(page)]) == 0
    open_offline(browser, page)
    browser.evaluate(TOOLS)
    browser.wait_for(f"[...Array({count}).keys()].every("
                     "k => meshes(`drake/visualizer/run_${k}/body`) > 0)")
    look(browser, tmp_path / "replay.png")
    body = "node('drake/visualizer/run_0/body').object"
    start = browser.evaluate(f"place({body}).toArray()")
    browser.evaluate("control('play').click()")
    browser.wait_for(
        f"place({body}).distanceTo(new MeshCat.THREE.Vector3(...{start})) > 1.0")
    assert browser.errors == []


def test_report_html(browser, folder, tmp_path):
    open_offline(browser, folder / "report.html")
    look(browser, tmp_path / "report.png")
    assert browser.evaluate("[...document.querySelectorAll('svg')].filter("
                            "each => each.getBoundingClientRect().height > 50).length") >= 3
    assert browser.errors == []
