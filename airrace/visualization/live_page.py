"""The live page of a race: Drake's Meshcat, the record of the race, and their server."""

import ctypes
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from airrace.common.command_line import typed_command
from airrace.common.errors import words
from airrace.common.files import write_text
from airrace.track import load_track
from airrace.vehicle import load_vehicle
from airrace.visualization.controls import PaceRequest
from airrace.visualization.loopback_server import Visitors
from airrace.visualization.meshcat_page import Audience, MakeMeshcat, SceneDrawing
from airrace.visualization.page_html import LIVE, REPLAY, make_page, page_config
from airrace.visualization.page_server import FILES, PageServer, Source
from airrace.visualization.page_sink import PageSink
from airrace.visualization.race_record import RaceRecord
from airrace.visualization.rotor_visualizer import PERIOD, RotorVisualizer, body_path, find_blades

if TYPE_CHECKING:
    from collections.abc import Iterable

    from pydrake.systems.framework import Context, Diagram

    from airrace.recording.race_events import RaceEvent, Sink
    from airrace.scenario import Scenario
    from airrace.track import Course

_NAP = 0.1  # s
_DRAWING_PERIOD = 0.1  # s of wall time, between two drawings of the scene
_RELOAD = 3.0  # s, that a page may be away


class LivePage:
    """A page that shows a race while it goes on; a context manager, which ends its server.

    No race ends because of its page. If something of it fails, one line is noted, and from then
    on nothing is drawn.

    Attributes:
        meshcat: that the scene is drawn in.
        record: of the race.
        pace: that pages ask for.
        url: of the page.
        note: shows a line.
        gone: whether something has failed.
    """

    def __init__(self, track: "Course", report: bool = False, allow_origin: "Iterable[str]" = ()):
        """Starts to serve, on loopback.

        Args:
            track: that is shown.
            report: whether report.html will stand beside the replay, which then links to it.
            allow_origin: of proxies that pages come through, see Visitors.

        Raises:
            UserError: if no port is free, or an origin is none.
        """
        visitors = Visitors(allow_origin)
        self.meshcat = MakeMeshcat(track)
        self.record, self.pace = RaceRecord(), PaceRequest()
        self.note: Callable[[str], object] = print
        self.gone = False
        self._scene: SceneDrawing | None = None
        self._next_drawing = 0.0
        self._config: dict = {}
        self._beside = ("report.html", "race.json") if report else ("race.json",)
        # The server's thread must not hold the Meshcat, so it is given only its port.
        pages = self._config
        self._server = PageServer(
            Source(
                make_page=lambda html: make_page(html, pages[LIVE]),
                meshcat=self.meshcat.web_url().removeprefix("http://"),
                record=self.record,
                pace=self.pace,
                visitors=visitors,
            )
        )
        self.url = self._server.url

    def __enter__(self) -> "LivePage":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the server; pages keep what they have."""
        self._server.close()
        try:
            self.meshcat.GetNumActiveConnections()
        except RuntimeError:
            # Its thread has died. To destroy it aborts this process, or never ends: it is kept.
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(self.meshcat))

    def begin(self, config: dict) -> None:
        """Says what race is shown; config: see page_config()."""
        self._config[LIVE] = config

    def sinks(self, scenario: "Scenario", simulation: "Diagram") -> tuple["Sink", ...]:
        """Begins to show a race; returns the sinks that show it.

        Args:
            scenario: the race.
            simulation: whose scene is shown; see draw().
        """
        sinks: list[Sink] = []
        self._try(lambda: sinks.extend(self._make_sinks(scenario, simulation)))
        return tuple(map(self._tried, sinks))

    def _make_sinks(self, scenario: "Scenario", simulation: "Diagram") -> tuple["Sink", ...]:
        track, (vehicle, _) = load_track(scenario.track), load_vehicle(scenario.drone)
        plant = simulation.GetSubsystemByName("plant")
        blades = find_blades(plant, simulation.GetSubsystemByName("scene_graph"), vehicle)
        body, meshcat = body_path(plant), self.meshcat
        self._scene = SceneDrawing(meshcat, simulation)
        self.begin(page_config(scenario, track, vehicle, body, mode=LIVE))
        page = PageSink(
            self.record,
            track,
            vehicle,
            meshcat=meshcat,
            audience=Audience(meshcat),
            keep_pictures=scenario.recording.content == "full",
        )
        audience = Audience(meshcat, PERIOD)
        return page.take, RotorVisualizer(meshcat, vehicle, body, blades, audience).take

    def _tried(self, sink: "Sink") -> "Sink":
        def take(event: "RaceEvent") -> None:
            self._try(lambda: sink(event))

        return take

    def _try(self, show: Callable[[], object]) -> None:
        """Does something for the page, unless it is gone."""
        if self.gone:
            return
        try:
            show()
        except Exception as e:
            self.gone = True
            self.note(
                f"The page is gone ({words(e)}); the race goes on without it and leaves no "
                f"race.html: use {typed_command()} replay."
            )

    def draw(self, root_context: "Context") -> None:
        """Draws the scene; root_context: of the diagram with the simulation.

        No more often than eyes follow, however fast the race is simulated.
        """
        if (now := time.perf_counter()) >= self._next_drawing:
            self._next_drawing = now + _DRAWING_PERIOD
            self._draw_scene(root_context)

    def _draw_scene(self, root_context: "Context") -> None:
        if (scene := self._scene) is not None:
            self._try(lambda: scene.draw(root_context))

    def end(self, root_context: "Context", data: dict) -> None:
        """Shows how a race has ended; data: what race.json holds."""
        self._try(lambda: self.record.end(root_context.get_time(), data))
        self._draw_scene(root_context)

    @property
    def watching(self) -> int:
        """How many pages are connected."""
        return self._server.watching

    def replay(self) -> str:
        """Returns what is recorded as a page that opens offline."""
        config = {
            **self._config[LIVE],
            "mode": REPLAY,
            "links": [[FILES[name], name] for name in self._beside],
        }
        return make_page(self.meshcat.StaticHtml(), config, self.record.whole())

    def save_replay(self, path: Path) -> None:
        """Writes replay() into a file, if it can."""
        self._try(lambda: write_text(path, self.replay()))

    def linger(
        self, folder: Path, most: float | None, note: Callable[[str], object] = print
    ) -> None:
        """Stays until Ctrl-C while a page is connected; without one, returns at once.

        Args:
            folder: of the results, which the page links to.
            most: the longest to stay (s); None: as long as somebody watches.
            note: shows a line.
        """
        self.pace.end()
        self._server.show_results(folder)
        if not self.watching or most == 0.0:
            return
        note(f"The page stays at {self.url}; Ctrl-C ends it.")
        start = seen = time.monotonic()
        try:
            while (now := time.monotonic()) < seen + _RELOAD:
                if most is not None and now > start + most:
                    return
                if self.watching:
                    seen = now
                time.sleep(_NAP)
        except KeyboardInterrupt:
            return
