"""A race, from its scenario to the files that it leaves: built, flown, saved.

`python -m airrace.diagrams.race` flies one, see race_command.py.
"""

import contextlib
import dataclasses as dc
import gc
import time
import traceback
import types
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder

from airrace.common.errors import OwnCodeError, UserError, words
from airrace.common.files import write_json, write_text
from airrace.common.interrupts import interrupt_flag
from airrace.diagrams.in_process import InProcess
from airrace.diagrams.own_systems import find_mistake
from airrace.diagrams.simulation import MakeMonitor, MakeSimulation
from airrace.diagrams.transport import POLL_PERIOD, Transport
from airrace.recording.course_result import CourseResult
from airrace.recording.foxglove_server import FoxgloveServer
from airrace.recording.log_sink import MakeLogSink
from airrace.recording.race_events import RaceEvent, RaceOver, Sink
from airrace.recording.race_observer import AddRaceObserver
from airrace.recording.race_result import RaceResult
from airrace.scenario import Scenario, scenario_yaml
from airrace.systems.mapping.gate_map_writer import GateMapWriter
from airrace.track import load_track
from airrace.track.gate_map import GateMap
from airrace.track.map_files import write_map
from airrace.visualization.controls import RaceControls

if TYPE_CHECKING:  # to import a web server takes its time, and many a race has no page
    from airrace.visualization.live_page import LivePage

# What a race may leave in its folder.
RESULTS = (
    "scenario.yaml",
    "map.json",
    "map_statistics.json",
    "race.json",
    "race.mcap",
    "betaflight.txt",
    "betaflight.bfl",
    "race.html",
    "report.html",
    "error.txt",
)
INTERRUPTED = "interrupted"  # why a race has ended, after Ctrl-C or SIGTERM
STOPPED = "stopped by an error"  # or so, after an exception


def run_race(
    scenario: Scenario,
    output_dir: Path,
    *,
    page: "LivePage | None" = None,
    sinks: Iterable[Sink] = (),
    transport: Transport | None = None,
    foxglove: FoxgloveServer | None = None,
) -> dict:
    """Flies a race and leaves its files.

    Ctrl-C and SIGTERM end the race within 0.1 s of simulated time; they and an exception
    in any system still leave every file, with what was flown.

    Args:
        scenario: the race.
        output_dir: an existing folder.
        page: to show the race on, or None.
        sinks: called every 0.1 s of simulated time with each RaceEvent since, and at last with a
            StateSample of where the drone then is.
        transport: joins simulation and autonomy; by default, both are in one diagram.
        foxglove: a server that gets what race.mcap gets, or None.

    Returns:
        what race.json holds.

    Raises:
        UserError: if something the scenario names cannot be had, or a file
            cannot be written.
        OwnCodeError: if a system of the scenario's own raised an exception; the whole traceback is
            left in error.txt.
    """
    transport = transport or InProcess()
    diagram = MakeRace(scenario, output_dir, page, transport, foxglove)
    race = _Race(scenario, output_dir, page, transport, diagram, sinks)
    with interrupt_flag() as interrupted:
        race.begin_files()
        try:
            race.start()
            # What is built is kept to the end: no need to look through it for garbage.
            gc.freeze()
            reason = race.fly(interrupted)
        except BaseException as e:
            mistake = None if interrupted.is_set else find_mistake(e, scenario)
            why = mistake.sentence if mistake else ""
            if scenario.systems and isinstance(e, UserError):  # as of what they give
                why = words(e)
            reason = f"{STOPPED}: {why}" if why else STOPPED
            race.rescue(INTERRUPTED if interrupted.is_set else reason)
            if isinstance(e, SystemExit):  # of a system of the user's; it would look like success
                raise UserError(
                    f"A system of the race has called exit({e.code}), and the race ends with it: "
                    "systems raise an exception if something is wrong."
                ) from e
            if mistake:
                file = output_dir / "error.txt"
                with contextlib.suppress(UserError):  # a full disk
                    write_text(file, "".join(traceback.format_exception(e)))
                sentence = f"airrace: {mistake.sentence}; the whole traceback is in {file}."
                raise OwnCodeError("\n".join([*mistake.frames, sentence])) from e
            raise
        finally:
            gc.unfreeze()
        return race.finish(reason or INTERRUPTED)


def MakeRace(
    scenario: Scenario,
    output_dir: Path | None = None,
    page: "LivePage | None" = None,
    transport: Transport | None = None,
    foxglove: FoxgloveServer | None = None,
) -> Diagram:
    """Builds a whole race: two subsystems, ``simulation`` and ``autonomy``.

    The two are joined by the names of their ports; a third, ``race_observer``, tells of them.

    Args:
        scenario: the race.
        output_dir: where the map and the recording are kept on disk; None: nowhere.
        page: to show the race on, or None.
        transport: where the autonomy is; by default, in the diagram.
        foxglove: a server that gets what the recording gets, or None.

    Raises:
        UserError: if something the scenario names cannot be had, or the recording
            cannot be written.
    """
    transport = transport or InProcess()
    if scenario.flight_controller not in transport.flight_controllers:
        raise UserError(
            f"With flight_controller '{scenario.flight_controller}' only `airrace race` flies, and "
            "no simulation with hardware in the loop: set it to internal."
        )
    builder = DiagramBuilder()
    simulation = builder.AddSystem(MakeSimulation(scenario, visible=page is not None))
    try:
        autonomy = transport.AddToBuilder(builder, scenario, simulation)
    except RuntimeError as e:  # only systems of the scenario's own can have such ports
        message = " ".join(str(e).split())
        raise UserError(f"The ports of the systems do not fit: {message}") from None
    if output_dir is not None and autonomy.HasOutputPort("gate_map"):
        writer = builder.AddNamedSystem(
            "gate_map_writer",
            GateMapWriter(directory=output_dir, period=scenario.perception.map_period),
        )
        builder.Connect(autonomy.GetOutputPort("gate_map"), writer.GetInputPort("gate_map"))
    log = MakeLogSink(scenario, output_dir, foxglove) if output_dir is not None else None
    shown = page.sinks(scenario, simulation) if page is not None else ()
    AddRaceObserver(builder, scenario, simulation, autonomy, log, shown)
    diagram = builder.Build()
    diagram.set_name("race")
    return diagram


def make_result(scenario: Scenario, simulation: str) -> RaceResult | CourseResult:
    """Returns what collects the results of a race; simulation: SITL, HITL or MAVLINK."""
    track = load_track(scenario.track)
    return (RaceResult if track.closed else CourseResult)(scenario, track, simulation)


class _Race:
    """A race that is being flown, and the files that it leaves."""

    def __init__(
        self,
        scenario: Scenario,
        output_dir: Path,
        page: "LivePage | None",
        transport: Transport,
        diagram: Diagram,
        sinks: Iterable[Sink],
    ):
        self._scenario, self._folder, self._page = scenario, output_dir, page
        self._transport, self._sinks = transport, tuple(sinks)
        self._diagram = diagram
        self._observer = diagram.GetSubsystemByName("race_observer")
        self._simulator, self._set_bodies = Simulator(diagram), MakeMonitor(diagram)
        ApplySimulatorConfig(scenario.simulator_config, self._simulator)
        self._result = make_result(scenario, transport.simulation)
        self._controls = None
        if page is not None and isinstance(transport, InProcess):  # others keep their own time
            self._controls = RaceControls(page.pace, self._simulator)
        self._clock = time.perf_counter()

    def begin_files(self):
        """Writes every file: from here on, whatever happens, each is there and valid."""
        write_text(self._folder / "scenario.yaml", scenario_yaml(self._scenario))
        if self._diagram.HasSubsystemNamed("gate_map_writer"):
            write_map(self._folder, GateMap())
        self._save_result("not over yet")

    def start(self):
        """Initializes simulation and autonomy."""
        self._simulator.Initialize()
        self._draw()
        self._transport.begin(self._simulator)

    def fly(self, interrupted: types.SimpleNamespace) -> str | None:
        """Flies until the referee ends the race; returns why it ended before, or None."""
        steps, reason = 0, None
        while not (self._result.over or interrupted.is_set or reason):
            steps += 1
            reason = self._transport.advance(self._simulator, steps * POLL_PERIOD)
            self._set_bodies(self._simulator.get_mutable_context())
            self._look()
            self._draw()
            if self._controls is not None:
                self._controls.steer(lambda: interrupted.is_set)
        return reason

    def _look(self):
        """Tells the result, and then the other sinks, what has happened since the last look."""
        laps = self._result.laps_flown
        happened = [*map(self._judged, self._observer.look(self._simulator.get_context()))]
        for event in happened:
            self._result.take(event)
        if self._result.laps_flown > laps:
            self._save_result("not over yet")
        for event in happened:
            for sink in self._sinks:
                sink(event)

    def _judged(self, event: RaceEvent) -> RaceEvent:
        """Returns an event; of the end of the race, with what only the link knows of it."""
        if isinstance(event, RaceOver):
            status = self._transport.judged(event.status, self._simulator)
            return dc.replace(event, status=status)
        return event

    def finish(self, reason: str) -> dict:
        """Ends the autonomy and brings every file up to date; returns race.json.

        Args:
            reason: why the race ended, if the referee did not end it.
        """
        self._transport.end(self._simulator)
        data = self._save_result(reason)
        self._tell_end(data)
        self._diagram.ForcedPublish(self._simulator.get_context())
        self._observer.close()
        self._save_replay()
        return data

    def rescue(self, reason: str) -> None:
        """Does what it can of finish() after an error, and raises nothing.

        The caller must learn of the first error, even if its cause also keeps a file from
        being written.
        """
        for step in (
            lambda: self._tell_end(self._save_result(reason)),
            lambda: self._diagram.ForcedPublish(self._simulator.get_context()),
            self._observer.close,
            self._save_replay,
            lambda: self._transport.end(self._simulator),
        ):
            with contextlib.suppress(Exception):
                step()

    def _save_result(self, reason: str) -> dict:
        wall = self._transport.wall(self._simulator)
        data = self._result.data(time.perf_counter() - self._clock, reason, wall)
        write_json(self._folder / "race.json", data)
        return data

    def _tell_end(self, data):
        """Tells the page how the race ended."""
        if self._page is not None:
            self._page.end(self._simulator.get_context(), data)

    def _draw(self):
        if self._page is not None:
            self._page.draw(self._simulator.get_context())

    def _save_replay(self):
        if self._page is not None:
            self._page.save_replay(self._folder / "race.html")
