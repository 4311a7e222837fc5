"""The live page of a race: Drake's Meshcat, the record of the race, and their server."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from airrace.track import load_track
from airrace.vehicle import load_vehicle
from airrace.visualization.controls import PaceRequest
from airrace.visualization.meshcat_page import Audience, MakeMeshcat
from airrace.visualization.page_html import LIVE, REPLAY, make_page, page_config
from airrace.visualization.page_server import FILES, PageServer, Source
from airrace.visualization.page_sink import PageSink
from airrace.visualization.race_record import RaceRecord
from airrace.visualization.rotor_visualizer import PERIOD, RotorVisualizer, body_path, find_blades

if TYPE_CHECKING:
    from pydrake.systems.framework import Diagram

    from airrace.recording.race_events import Sink
    from airrace.scenario import Scenario
    from airrace.track import Course

_NAP = 0.1  # s
_RELOAD = 3.0  # s, that a page may be away


class LivePage:
    """A page that shows a race while it goes on; a context manager, which ends its server.

    Attributes:
        meshcat: that the scene is drawn in.
        record: of the race.
        pace: that pages ask for.
        url: of the page.
    """

    def __init__(self, track: "Course", report: bool = False):
        """Starts to serve, on loopback.

        Args:
            track: that is shown.
            report: whether report.html will stand beside the replay, which then links to it.

        Raises:
            UserError: if no port is free.
        """
        self.meshcat = MakeMeshcat(track)
        self.record, self.pace = RaceRecord(), PaceRequest()
        self._config: dict = {}
        self._beside = ("report.html", "race.json") if report else ("race.json",)
        # The server's thread must not hold the Meshcat, so it is given only its port.
        pages = self._config
        self._server = PageServer(
            Source(
                make_page=lambda html: make_page(html, pages[LIVE]),
                meshcat_port=self.meshcat.port(),
                record=self.record,
                pace=self.pace,
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

    def begin(self, config: dict) -> None:
        """Says what race is shown; config: see page_config()."""
        self._config[LIVE] = config

    def sinks(self, scenario: "Scenario", simulation: "Diagram") -> tuple["Sink", ...]:
        """Begins to show a race; returns the sinks that show it.

        Args:
            scenario: the race.
            simulation: which draws its scene in the Meshcat.
        """
        track, (vehicle, _) = load_track(scenario.track), load_vehicle(scenario.drone)
        plant = simulation.GetSubsystemByName("plant")
        blades = find_blades(plant, simulation.GetSubsystemByName("scene_graph"), vehicle)
        body, meshcat = body_path(plant), self.meshcat
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
