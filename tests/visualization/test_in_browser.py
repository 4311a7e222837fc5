"""The pages as people see them: the live view, the replays and the report, in a browser."""

import re
import signal
import subprocess
import sys
import threading
import time
import urllib.request

import cv2
import numpy as np
import pytest

from airrace.commands.app import main as airrace
from tests.visualization.browser import CHROMIUM, Browser
from tests.visualization.layout import WIDTHS, check_page, check_panels
from tests.worlds.cases import first
from tests.worlds.made_up_run import FIRST, LAP, estimator_sigmas, make_run
from tests.worlds.pictures import count_colours

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium to look with")
CAMERAS = ("overview", "chase", "onboard", "gate", "free")
# px, the height of the ring around the drone.
RING = "airrace.halo.share * airrace.stage.canvas.clientHeight"
# px, the height of the smallest number above a gate.
NUMBERS = """Math.min(...airrace.numbers.sprites.map(({ position: { x, y, z }, scale }) => {
  const up = new MeshCat.THREE.Vector3().setFromMatrixColumn(viewer.camera.matrixWorld, 1);
  const [top, end] = [0.5, -0.5].map((k) => airrace.stage.world([x, y, z])
    .addScaledVector(up, k * scale.y).project(viewer.camera).y);
  return ((top - end) / 2) * airrace.stage.canvas.clientHeight; }))"""
SIZES = ((1280, 720), (1920, 1080), (390, 844))
# Where the drone is on the screen, and how far from the camera (m).
TOOLS = """
var body = () => airrace.stage.object(airrace.config.body);
var place = object => new MeshCat.THREE.Vector3().setFromMatrixPosition(object.matrixWorld);
var meshes = path => { let count = 0; airrace.stage.object(path)?.traverse(
  each => count += each.isMesh === true); return count; };
var distance = () => place(viewer.camera).distanceTo(place(body()));
var text = id => document.getElementById(id).innerText;
var key = (code, key = code, options = {}) => window.dispatchEvent(
  new KeyboardEvent("keydown", {code, key, bubbles: true, ...options}));
var seconds = s => new Promise(done => setTimeout(done, 1000 * s));
"""


@pytest.fixture(scope="module")
def window():
    with Browser(slowly=True) as browser:
        yield browser


@pytest.fixture
def browser(window):
    """A browser whose page goes with the test: a scene is drawn as long as it is there."""
    yield window
    window.open("about:blank")


class LiveRace:
    """A race of one lap in a process of its own, in real time.

    Attributes:
        url: of its page.
        folder: of its results.
    """

    def __init__(self, track, folder):
        self.folder, self.url, self.flies, self._said = folder, None, False, []
        arguments = ["--track", track, "--laps", "1", "--realtime_rate", "1"]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "airrace", "race", "--output", str(folder), *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self):
        for line in self.process.stdout:
            self._said.append(line)
            if line.startswith("Watch it at "):
                self.url = line.split()[-1]
            self.flies = self.flies or "TAKE_OFF" in line

    def said(self, words):
        return any(words in line for line in self._said)

    def stop(self):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        assert self.process.wait(60.0) in (0, 1), "".join(self._said)


@pytest.fixture(scope="module")
def race(hexagon, tmp_path_factory):
    race = LiveRace(hexagon, tmp_path_factory.mktemp("races") / "race")
    try:
        until(lambda: race.flies, patience=300.0)  # it may have to compile
        yield race
    finally:
        race.stop()


@pytest.fixture(scope="module")
def folder(race):
    """Of the race, when it is over, whichever of these tests this process has run before."""
    until(lambda: race.said("lap 1: "), patience=300.0)
    race.stop()
    return race.folder


def until(condition, patience=60.0):
    deadline = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def open_page(browser, url):
    browser.open(url)
    browser.wait_for("!!window.airrace && airrace.timeline.count > 0")
    browser.evaluate(TOOLS)
    browser.wait_for("meshes(airrace.config.body) > 5 && meshes('drake/visualizer') > 50")


def look(browser, name):
    """Returns what is seen, which is kept on disk, and is more than a background."""
    picture = browser.screenshot()
    cv2.imwrite(str(name), picture)
    assert picture.std() > 10.0
    assert count_colours(picture) > 100
    return picture


def largest_share(picture):
    """Returns the share of the commonest colour, of eight levels a channel."""
    levels = (picture // 32).astype(int)
    return np.bincount((levels @ [64, 8, 1]).ravel()).max() / levels[..., 0].size


@pytest.mark.slow
def test_the_live_page(browser, race, tmp_path):
    open_page(browser, race.url)
    browser.wait_for("airrace.feed.open && viewer.connection?.readyState === WebSocket.OPEN")
    views = {}
    for view in CAMERAS:
        browser.evaluate(f"document.querySelector('[data-view={view}]').click()")
        browser.evaluate("seconds(1)")
        views[view] = look(browser, tmp_path / f"{view}.png").astype(float)
        assert largest_share(views[view]) < 0.6, view
        near, far = {"chase": (2.0, 8.0), "onboard": (0.0, 1.5)}.get(view, (2.0, 200.0))
        assert near <= browser.evaluate("distance()") < far, view
    for one, other in zip(CAMERAS[:4], CAMERAS[1:4]):
        assert np.abs(views[one] - views[other]).mean() > 5.0, (one, other)
    assert browser.evaluate("airrace.timeline.pictures.length > 0")
    for width, height in WIDTHS:
        browser.resize(width, height)
        browser.evaluate("seconds(0.5)")
        check_panels(browser, width)
    browser.resize(640, 400)
    assert browser.errors == []
    own = race.url.rstrip("/") + "/"
    assert {url for url in browser.requests if not url.startswith((own, "data:", "blob:"))} == set()


@pytest.mark.slow
def test_clock_and_minimap_run(browser, race):
    open_page(browser, race.url)
    before = browser.evaluate("[text('lap-time'), document.getElementById('minimap').toDataURL()]")
    browser.wait_for(
        f"text('lap-time') !== '{before[0]}' && "
        f"document.getElementById('minimap').toDataURL() !== '{before[1]}'"
    )
    assert browser.evaluate("text('doing')")
    assert browser.errors == []


@pytest.mark.slow
def test_pause_and_speed(browser, race):
    """Of the race itself, and of what is shown alone."""
    open_page(browser, race.url)
    browser.wait_for("airrace.feed.controls?.rate === 1")
    browser.evaluate("key('Space')")
    browser.wait_for("airrace.feed.controls.paused")
    time.sleep(0.3)  # until the race sees it
    end = browser.evaluate("airrace.timeline.end")
    browser.evaluate("seconds(1)")
    assert browser.evaluate("airrace.timeline.end") == pytest.approx(end, abs=0.15)
    browser.evaluate("key('Space')")
    browser.wait_for(f"airrace.timeline.end > {end} + 0.3")
    browser.evaluate("airrace.bar.setRate(0.25)")
    browser.wait_for("airrace.feed.controls.rate === 0.25")
    time.sleep(0.5)
    assert browser.evaluate("""(async () => {
        const wall = performance.now(), start = airrace.timeline.end;
        await seconds(3);
        return (airrace.timeline.end - start) / (performance.now() - wall) * 1000;
    })()""") == pytest.approx(0.25, abs=0.1)
    browser.evaluate("airrace.player.jump(1.0); airrace.player.pause()")
    browser.evaluate("seconds(0.5)")
    assert browser.evaluate("airrace.player.time") == pytest.approx(1.0)
    assert browser.evaluate("airrace.feed.controls.paused") is False
    browser.evaluate("key('KeyL')")
    browser.wait_for("airrace.player.time > airrace.timeline.end - 1")
    assert browser.errors == []


@pytest.mark.slow
def test_results_stay_after_the_finish(browser, race, tmp_path):
    open_page(browser, race.url)
    browser.wait_for("airrace.feed.controls !== null")
    browser.evaluate("airrace.bar.setRate(0)")
    browser.wait_for("airrace.timeline.over?.finished", patience=240.0)
    browser.wait_for("document.querySelectorAll('#results a').length === 3")
    assert browser.evaluate("text('results')").startswith("Finished")
    until(lambda: race.said("The page stays at"))
    time.sleep(1.0)
    assert race.process.poll() is None
    links = browser.evaluate("[...document.querySelectorAll('#results a')].map(each => each.href)")
    fetched = "async each => { const it = await fetch(each); await it.blob(); return it.status; }"
    status = f"Promise.all({links}.map({fetched}))"
    assert browser.evaluate(status) == [200, 200, 200]
    assert browser.errors == []
    race.stop()
    browser.wait_for("!airrace.feed.open")
    browser.evaluate("seconds(2)")  # Drake's page would try to connect again
    assert "best lap" in browser.evaluate("text('results')")
    assert not browser.evaluate("document.getElementById('lost').hidden")
    look(browser, tmp_path / "results.png")
    assert browser.errors == []


def open_offline(browser, page):
    browser.open(page.as_uri())
    assert page.as_uri() in browser.requests
    assert {url.partition(":")[0] for url in browser.requests} <= {"file", "data", "blob"}


def open_replay(browser, page):
    open_offline(browser, page)
    browser.wait_for("!!window.airrace && airrace.timeline.count > 0")
    browser.evaluate(TOOLS)
    browser.wait_for("meshes(airrace.config.body) > 5 && meshes('drake/visualizer') > 50")


@pytest.mark.slow
def test_the_replay_scrubs_and_jumps(browser, folder, tmp_path):
    open_replay(browser, folder / "race.html")
    assert (folder / "race.html").stat().st_size < 30e6
    browser.evaluate("airrace.bar.jumpLap(1)")
    lap = browser.evaluate("airrace.timeline.crossings[0].t")
    assert browser.evaluate("airrace.player.time") == pytest.approx(lap - 1.0, abs=0.01)
    # Where the record has the drone, it stands in the scene.
    browser.evaluate(f"airrace.player.jump({lap} + 3)")
    browser.wait_for("text('lap-time') === '3.0'")
    shown = browser.evaluate("body().position.toArray()")
    expected = browser.evaluate(f"airrace.timeline.sample({lap} + 3).p")
    np.testing.assert_allclose(shown, expected, atol=1e-6)
    assert "next gate 3" in browser.evaluate("text('doing')")
    first = look(browser, tmp_path / "lap.png")
    browser.evaluate("key('ArrowRight', 'ArrowRight', {shiftKey: true})")
    assert browser.evaluate("airrace.player.time") > lap + 3.0
    browser.evaluate("key('ArrowLeft')")
    browser.evaluate("""{
        const range = document.getElementById("time");
        range.value = 5;
        range.dispatchEvent(new Event("input"));
    }""")
    assert browser.evaluate("airrace.player.time") == pytest.approx(5.0)
    assert np.abs(first.astype(float) - look(browser, tmp_path / "start.png")).mean() > 1.0
    browser.evaluate("airrace.player.setRate(4); airrace.player.play()")
    browser.wait_for("airrace.player.time > 7")
    browser.evaluate("airrace.player.pause()")
    assert browser.errors == []


@pytest.mark.slow
def test_splits_are_compared_with_the_best_lap(browser, folder):
    """On three gates: laps of 10 s, 9 s, 12 s, and a fourth that has begun."""
    open_replay(browser, folder / "race.html")
    seen = browser.evaluate("""(async () => {
        const { standing } = await import("airrace/standing.js");
        const { Timeline } = await import("airrace/timeline.js");
        const timeline = new Timeline();
        const times = [10, 14, 17, 20, 23.5, 26.75, 29, 32, 37, 41, 44.5, 48];
        timeline.add({ crossings: times.map((t, k) => ({ t, gate: k % 3 + 1 })) });
        const config = { gates: [1, 2, 3], laps: 5 };
        return [15, 24, 30, 33, 38, 45, 49].map((t) => {
            const { lap, nextGate, lapTime, split } = standing(timeline, config, t);
            return [lap, nextGate, lapTime, split.delta, split.kind];
        });
    })()""")
    assert seen == [
        [1, 3, 5, None, ""],
        [2, 3, 4, -0.5, "best"],
        [3, 2, 1, -1, "best"],
        [3, 3, 4, -0.5, "best"],
        [3, 1, 9, 1.25, "slower"],
        [4, 3, 4, 0, "slower"],
        [4, 1, 8, 0.25, "better"],
    ]


@pytest.mark.slow
def test_before_gate_1_it_says_what_goes_on(browser, folder):
    """Of who explores, and of a client's drone, which waits, and races."""
    open_replay(browser, folder / "race.html")
    said = browser.evaluate("""(async () => {
        const { phase, standing, words } = await import("airrace/standing.js");
        const { Timeline } = await import("airrace/timeline.js");
        const timeline = new Timeline(), config = { gates: [1, 2, 3], laps: 5 };
        const [gates, racing] = [0, false];
        timeline.add({ status: [
            { t: 0, state: "FLY_TO_GATE", gates, done: false, racing },
            { t: 1, state: "DONE", gates, done: true, racing: true },
            { t: 2, state: "ON_PAD", gates, done: false, racing },
            { t: 3, state: "RACE", gates, done: true, racing },
        ] });
        return [0, 1, 2, 3].map((t) => {
            const stands = standing(timeline, config, t + 0.5);
            return [phase(stands), words(stands, config)];
        });
    })()""")
    to_gate_1 = "Flying to gate 1 to start the first lap"
    assert said == [
        ["exploring the track", "Flying to gate 1"],
        ["before gate 1", to_gate_1],
        ["before the start", "On the pad, waiting for the client to arm"],
        ["before gate 1", to_gate_1],
    ]


@pytest.mark.slow
def test_what_a_client_knows_of_the_track_is_not_told(browser, folder):
    open_replay(browser, folder / "race.html")
    said = browser.evaluate("""(async () => {
        const { drawFacts } = await import("airrace/facts.js");
        const { Timeline } = await import("airrace/timeline.js");
        const timeline = new Timeline(), config = { gates: [1, 2, 3] };
        timeline.add({ status: [
            { t: 0, state: "TAKE_OFF", gates: 2, done: false, racing: false },
            { t: 1, state: "ON_PAD", gates: 0, done: false, racing: false },
            { t: 2, state: "RACE", gates: 0, done: true, racing: false },
        ] });
        return [0, 1, 2].map((t) => {
            drawFacts(timeline, config, t + 0.5, { p: [0, 0, 1.5], error: 0 });
            return document.getElementById("facts").textContent;
        });
    })()""")
    assert said == ["gates known2 of 3height1.5 m", "height1.5 m", "height1.5 m"]


@pytest.mark.slow
def test_panels_hold_at_every_width(browser, folder):
    """With events and legend closed and open."""
    open_replay(browser, folder / "race.html")
    browser.evaluate("airrace.player.pause()")
    for width, height in WIDTHS:
        browser.resize(width, height)
        browser.evaluate("airrace.player.jump(airrace.timeline.crossings.at(-1).t - 1)")
        browser.evaluate("seconds(0.8)")
        panels = check_panels(browser, width)
        assert {"clock", "bar", "picture", "facts"} <= set(panels)
        # The track is beside the column of panels.
        right = browser.evaluate("""airrace.config.gates.map(({ pylons }) => Math.max(...pylons.map(
            ([x, y]) => airrace.stage.onScreen([x, y, 5]).x))).reduce((a, b) => Math.max(a, b))""")
        side = browser.evaluate("document.getElementById('side').getBoundingClientRect().left")
        assert width < 700 or (right + 1) * width / 2 < side
        assert browser.evaluate(RING) >= 33.0
        assert browser.evaluate(NUMBERS) >= 15.0
        for opened in ("events-button", "legend-button"):
            browser.evaluate(f"document.getElementById('{opened}').click()")
            assert check_panels(browser, width) != [] and "clock" in panels
            browser.evaluate(f"document.getElementById('{opened}').click()")
    browser.tap("#help-button")
    browser.wait_for("document.getElementById('help').open")
    browser.tap("#help button")
    browser.wait_for("!document.getElementById('help').open")
    browser.resize(640, 400)
    assert browser.errors == []


@pytest.mark.slow
def test_events_are_all_there_in_order(browser, folder):
    open_replay(browser, folder / "race.html")
    browser.evaluate("airrace.player.pause(); airrace.player.jump(airrace.timeline.end)")
    browser.resize(1600, 900)
    browser.evaluate("seconds(0.5)")
    times = browser.evaluate("airrace.timeline.events.map((each) => each.t)")
    assert times == sorted(times) and len(times) > 14
    shown = browser.evaluate("""[...document.querySelectorAll("#events li")].map((line) => {
        const text = line.querySelector("span");
        return [line.innerText, text.scrollWidth - text.clientWidth]; })""")
    assert len(shown) == len(times) and "calibrate" in shown[-1][0]
    assert max(cut for _, cut in shown) <= 0
    crossing = browser.evaluate("""(async () => {
        const { Timeline } = await import("airrace/timeline.js");
        const timeline = new Timeline();
        timeline.add({ events: [{ t: 2, text: "plan" }] });
        timeline.add({ events: [{ t: 1, text: "gate" }] });
        return timeline.events.map((each) => each.text);
    })()""")
    assert crossing == ["gate", "plan"]
    browser.resize(640, 400)


@pytest.mark.slow
def test_the_report_opens_from_the_replay_as_a_file(browser, folder):
    open_replay(browser, folder / "race.html")
    browser.resize(1280, 720)
    assert browser.evaluate("document.querySelector('#links a').href") == (
        (folder / "report.html").as_uri()
    )
    assert browser.click("#links a") == (folder / "report.html").as_uri()
    browser.resize(640, 400)


@pytest.mark.repeats
def test_every_camera_and_every_size(browser, folder, tmp_path):
    """Nothing is covered, nothing leaves the window, and a frame is not too much to draw."""
    open_replay(browser, folder / "race.html")
    browser.evaluate("airrace.player.jump(airrace.timeline.end - 4)")
    for (width, height), theme in zip(SIZES, ("light", "dark", "light")):
        browser.resize(width, height, theme)
        browser.evaluate("seconds(0.5)")
        # To draw large pictures takes its time here.
        for view in CAMERAS if width == SIZES[0][0] else CAMERAS[:1]:
            browser.evaluate(f"airrace.cameras.choose('{view}')")
            browser.evaluate("seconds(0.3)")
            picture = look(browser, tmp_path / f"{view}_{width}.png")
            assert largest_share(picture) < 0.6, (view, width)
        outside = browser.evaluate("""
            [...document.querySelectorAll("#race .panel, #race button, #race select")]
            .map(each => [each.id || each.innerText, each.getBoundingClientRect()])
            .filter(([_, box]) => box.width > 0 && (box.left < -4 || box.top < -4 ||
                box.right > innerWidth + 4 || box.bottom > innerHeight + 4))
            .map(([name]) => name)""")
        assert outside == [], width
    render = browser.evaluate("({...viewer.renderer.info.render})")
    assert render["calls"] < 400 and render["triangles"] < 300_000
    browser.resize(640, 400, "light")
    assert browser.errors == []


@pytest.mark.slow
def test_a_film_is_one(browser, folder):
    open_replay(browser, folder / "race.html")
    browser.evaluate("""{
        HTMLAnchorElement.prototype.click = () => {};  // where it would be saved to
        airrace.player.jump(40);
        document.getElementById("film").click();
    }""")
    browser.evaluate("seconds(4)")
    browser.evaluate("document.getElementById('film').click()")
    browser.wait_for("airrace.film.saved?.size > 1000")
    browser.evaluate("""{
        window.video = document.createElement("video");
        video.muted = true;
        video.src = URL.createObjectURL(airrace.film.saved);
        video.play();
    }""")
    browser.wait_for("video.currentTime > 0.3 || video.error", patience=30.0)
    assert browser.evaluate("video.error?.message") is None
    width, height = browser.evaluate("[video.videoWidth, video.videoHeight]")
    canvas = browser.evaluate(
        "[viewer.renderer.domElement.width, viewer.renderer.domElement.height]"
    )
    assert [width, height] == [each & ~1 for each in canvas]
    assert browser.errors == []


@pytest.mark.repeats
def test_a_long_race_fits_into_the_memory(browser, folder):
    """1000 s with everything that a race tells, and five pictures a second."""
    open_replay(browser, folder / "race.html")
    browser.evaluate("""{
        const { timeline } = airrace, columns = 11, first = timeline.end;
        const rows = new Float32Array(columns * 30 * 1000);
        for (let k = 0; k < 30000; k++) {
            rows.set(timeline.row(k % timeline.count), columns * k);
            rows[columns * k] = first + (k + 1) / 30;
        }
        timeline.addFrames(rows);
        const pictures = timeline.pictures.slice();
        for (let k = 0; k < 5000; k++) {
            const { jpeg, markers } = pictures[k % pictures.length];
            // A text of its own, as if it had come over the network.
            const own = JSON.parse(JSON.stringify({ jpeg, markers }));
            timeline.add({ pictures: [{ t: first + k / 5, ...own }] });
        }
        airrace.player.jump(timeline.end - 5);
        airrace.player.play();
    }""")
    browser.evaluate("seconds(3)")
    assert browser.evaluate("airrace.timeline.end") > 1000.0
    assert browser.heap() < 500e6
    assert browser.errors == []


@pytest.mark.slow
@pytest.mark.parametrize("count", first([2, 1]))
def test_replay(browser, count, tmp_path):
    folders = [tmp_path / f"run{k}" for k in range(count)]
    for k, folder in enumerate(folders):
        make_run(folder, laps=k + 1, estimator="vio" if count == 1 else "truth")
    page = tmp_path / "replay.html"
    assert airrace(["replay", *map(str, folders), "--html", str(page)]) == 0
    open_replay(browser, page)
    browser.evaluate(f"airrace.player.jump({0.7 * LAP})")
    browser.evaluate("seconds(0.5)")
    look(browser, tmp_path / "replay.png")
    assert browser.evaluate("airrace.ghosts.length") == count - 1
    check_estimate(browser, is_there=count == 1)
    if count > 1:
        # They fly the same circle at the same time.
        assert re.search(
            r"run1, best lap 5.00 s: [+\u2212]0\.0\d s", browser.evaluate("text('others')")
        )
        # While it explores there is no gap to tell.
        browser.evaluate(f"airrace.player.jump({FIRST / 2})")
        browser.evaluate("seconds(0.5)")
        assert "run1, best lap 5.00 s: 0 gates so far" in browser.evaluate("text('others')")
    start = browser.evaluate("airrace.player.time")
    browser.evaluate("key('Space')")
    browser.wait_for(f"airrace.player.time > {start} + 0.5")
    assert browser.errors == []


def check_estimate(browser, is_there):
    """Whether a translucent twin of the drone is where the drone believes to be."""
    assert bool(browser.evaluate("airrace.estimate.twin.visible")) == is_there
    assert ("estimator, 1 \u03c3" in browser.evaluate("text('facts')")) == is_there
    if is_there:
        browser.evaluate("airrace.player.jump(4.95)")  # in the dark for 0.95 s
        browser.evaluate("seconds(0.5)")
        radii = browser.evaluate("airrace.estimate.ellipsoid.scale.toArray()")
        np.testing.assert_allclose(radii, 3 * estimator_sigmas(4.95)[3], rtol=0.15)
        offset, shown = (
            browser.evaluate(f"{object}.position.distanceTo(body().position)")
            for object in ("airrace.estimate.ellipsoid", "airrace.estimate.twin")
        )
        assert offset == shown and 0.0 < offset < 5 * estimator_sigmas(4.95)[3]
        copied = browser.evaluate(
            "(() => { let n = 0; airrace.estimate.twin.traverse(each => n += each.isMesh === true);"
            "return n; })()"
        )
        assert copied == browser.evaluate("meshes(airrace.config.body)") > 0


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
            url = line.split()[3]
            open_page(browser, url)
            look(browser, tmp_path / "replay.png")
            # Whether a browser asks for it, and when, is up to the browser.
            with urllib.request.urlopen(f"{url}/favicon.ico") as answer:
                assert answer.status == 204
        finally:
            program.terminate()
    assert browser.errors == []


@pytest.mark.slow
def test_report_html(browser, folder, tmp_path):
    check_page(browser, (folder / "report.html").as_uri())
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
