"""Flown runs again, on one page: drones of different colours."""

import dataclasses as dc
import logging
from collections.abc import Iterable, Sequence

from pydrake.geometry import IllustrationProperties, Meshcat, Rgba, RoleAssign
from pydrake.multibody.parsing import Parser

from airrace.analysis import Run
from airrace.analysis.log import reading
from airrace.analysis.recorded_events import recorded_events
from airrace.common.errors import UserError
from airrace.rendering.scene.scenery import AddPad, AddScenery
from airrace.vehicle import load_vehicle
from airrace.visualization.meshcat_page import MakeMeshcat, draw_bodies
from airrace.visualization.page_html import REPLAY, make_page, page_config
from airrace.visualization.page_sink import PageSink
from airrace.visualization.race_record import RaceRecord

# Blue, orange, green, purple, ...: far apart for all eyes.
COLORS = {
    "blue": (0.10, 0.45, 0.95),
    "orange": (0.95, 0.50, 0.05),
    "green": (0.10, 0.65, 0.35),
    "purple": (0.60, 0.25, 0.75),
    "yellow": (0.90, 0.80, 0.10),
    "grey": (0.35, 0.35, 0.40),
}
_ALPHA = 0.6


@dc.dataclass(frozen=True)
class Ghost:
    """The part of a run that is shown."""

    run: Run  #: with its state recorded
    start: float  #: which of its times is time zero of the replay (s)
    color: str  #: a key of COLORS


def make_ghosts(runs: "Sequence[Run]", align: str = "start", lap: int = 1) -> list:
    """Returns the Ghosts of some runs of one track.

    Args:
        runs: Runs.
        align: "start": all from power on; "lap": all cross gate 1 at time zero.
        lap: which lap begins then.

    Raises:
        UserError: if they cannot be shown together.
    """
    if len(runs) > len(COLORS):
        raise UserError(f"A replay shows at most {len(COLORS)} runs, not {len(runs)}.")
    ghosts = []
    for run, color in zip(runs, COLORS):
        if len(run.state["time"]) < 2:
            lacks = "flight in its race.mcap" if run.recorded else "race.mcap"
            raise UserError(
                f"{run.folder} has no {lacks}; name a race that was "
                "recorded, --record light or full."
            )
        if run.track != runs[0].track:
            raise UserError(
                f"{run.folder} was flown on another track than {runs[0].folder}; "
                "name runs of one track."
            )
        start = 0.0
        if align == "lap":
            starts = run.lap_starts
            laps = len(starts) - run.result["finished"]  # the last crossing of gate 1 ended it
            if not 1 <= lap <= laps:
                choice = f"choose --lap 1 to {laps}, or" if laps > 1 else "choose"
                raise UserError(
                    f"{run.folder} has no lap {lap}, only {laps}; {choice} --align start."
                )
            start = float(starts[lap - 1])
        ghosts.append(Ghost(run, start, color))
    return ghosts


def replay_page(
    ghosts: "Sequence[Ghost]", links: Iterable[tuple[str, str]] = (), pictures: bool = True
) -> str:
    """Returns a page, HTML, that shows the first of some runs again, with the others beside it.

    Args:
        ghosts: of make_ghosts().
        links: that the page has, pairs of text and address.
        pictures: whether it shows those of the first run's camera.
    """
    first = ghosts[0]
    meshcat = MakeMeshcat(first.run.track)
    draw_bodies(meshcat, lambda plant, scene_graph: _add_bodies(plant, scene_graph, ghosts))
    run = first.run
    config = page_config(run.scenario, run.track, run.vehicle, _body(0), mode=REPLAY, links=links)
    config["begin"] = first.start
    if len(ghosts) > 1:
        config["name"] = {"text": _words(first), "color": COLORS[first.color]}
    config["ghosts"] = [
        {
            "name": _words(ghost),
            "color": COLORS[ghost.color],
            "body": f"drake/{_body(i)}",
            "shift": ghost.start - first.start,
            "record": record_of(ghost.run, pictures=False).whole(),
        }
        for i, ghost in enumerate(ghosts)
        if i > 0
    ]
    record = record_of(run, pictures, meshcat).whole()
    with reading(run.folder, "what the page is made of"):
        return make_page(meshcat.StaticHtml(), config, record)


def record_of(run: Run, pictures: bool = True, meshcat: Meshcat | None = None) -> RaceRecord:
    """Returns what the page of a run that was recorded shows.

    Args:
        run: with its state recorded.
        pictures: whether it shows those of the camera; they are most of it.
        meshcat: to draw the plans' arrows in, if any.

    Raises:
        UserError: if an older airrace has recorded the run.
    """
    record = RaceRecord()
    sink = PageSink(record, run.track, run.vehicle, meshcat=meshcat)
    for event in recorded_events(run, pictures):
        with reading(run.folder, f"the {type(event).__name__} at {event.time:.2f} s"):
            sink.take(event)
    record.end(float(run.state["time"].iloc[-1]), run.result)
    return record


def _body(i: int) -> str:
    return f"visualizer/run_{i}/body"


def _words(ghost: Ghost) -> str:
    best = ghost.run.result["best_lap_s"]
    return ghost.run.folder.resolve().name + (f", best lap {best:.2f} s" if best else "")


def _add_bodies(plant, scene_graph, ghosts):
    """Adds the track, and drones that do not move yet."""
    track = ghosts[0].run.track
    AddScenery(plant, track)
    AddPad(plant, track.start, ghosts[0].run.vehicle.radius)
    for i, ghost in enumerate(ghosts):
        _, sdf = load_vehicle(ghost.run.scenario.drone)
        parser = Parser(plant)
        parser.SetAutoRenaming(True)
        (instance,) = parser.AddModels(str(sdf))
        plant.RenameModelInstance(instance, f"run_{i}")
        if len(ghosts) > 1:
            _paint(plant, scene_graph, plant.GetBodyByName("body", instance), ghost.color)


def _paint(plant, scene_graph, body, color):
    """Gives all visuals of a body one translucent colour."""
    properties = IllustrationProperties()
    properties.AddProperty("phong", "diffuse", Rgba(*COLORS[color], _ALPHA))
    drake = logging.getLogger("drake")
    level = drake.level
    drake.setLevel(logging.ERROR)  # it warns that visualizers may exist, which is not so here
    for geometry in plant.GetVisualGeometriesForBody(body):
        if scene_graph.model_inspector().GetIllustrationProperties(geometry) is not None:
            scene_graph.AssignRole(plant.get_source_id(), geometry, properties, RoleAssign.kReplace)
    drake.setLevel(level)
