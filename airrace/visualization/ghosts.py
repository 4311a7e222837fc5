"""Several flown runs in one Meshcat: drones of different colours, and their paths."""

import dataclasses as dc
import logging
from collections.abc import Iterable, Sequence
from html import escape

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.geometry import IllustrationProperties, Meshcat, Rgba, RoleAssign, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from scipy.spatial.transform import Rotation, Slerp

from airrace.analysis import Run
from airrace.common.errors import UserError
from airrace.rendering.scene.pad import AddPad
from airrace.rendering.scene.scenery import AddScenery
from airrace.vehicle import load_vehicle
from airrace.visualization.meshcat_page import draw_bodies

RATE = 30.0  # Hz, of a replay's frames
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
_BALL = 1.2  # m, around a drone, which is too small to see from afar
_TRAIL_STEP = 0.1  # s


@dc.dataclass(frozen=True)
class Ghost:
    """The part of a run that is shown.

    Attributes:
        run: with its state recorded.
        start: which of its times is time zero of the replay (s).
        color: a key of COLORS.
    """

    run: Run
    start: float
    color: str

    @property
    def duration(self) -> float:
        """From time zero to its end (s)."""
        return float(self.run.state["time"].iloc[-1]) - self.start

    def poses(self, times: np.ndarray) -> tuple:
        """Returns positions, (n, 3) m, and quaternions w, x, y, z, (n, 4), at replay times (s)."""
        state = self.run.state
        at = np.clip(np.asarray(times) + self.start, state["time"].iloc[0], state["time"].iloc[-1])
        R_WB = Rotation.from_quat(state[["qw", "qx", "qy", "qz"]].to_numpy(), scalar_first=True)
        p_WB = np.column_stack([np.interp(at, state["time"], state[axis]) for axis in "xyz"])
        return p_WB, Slerp(state["time"], R_WB)(at).as_quat(scalar_first=True)


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
            raise UserError(
                f"{run.folder} has no flight in its race.mcap; name a race that was "
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


def show_ghosts(meshcat: Meshcat, ghosts: Iterable[Ghost]) -> None:
    """Draws track, drones and their paths, and records the flight for the page's controls.

    Args:
        meshcat: to show it in.
        ghosts: Ghosts.
    """
    draw_bodies(meshcat, lambda plant, scene_graph: _add_bodies(plant, scene_graph, ghosts))
    duration = max(ghost.duration for ghost in ghosts)
    times = np.arange(0.0, duration, 1 / RATE)
    meshcat.StartRecording(frames_per_second=RATE, set_visualizations_while_recording=False)
    for i, ghost in enumerate(ghosts):
        trail = ghost.poses(np.arange(0.0, ghost.duration, _TRAIL_STEP))[0].T
        color = Rgba(*COLORS[ghost.color], 1.0)
        meshcat.SetLine(f"trails/run_{i}", np.ascontiguousarray(trail), 2.0, color)
        body = f"visualizer/run_{i}/body"
        meshcat.SetObject(f"{body}/ball", Sphere(_BALL), Rgba(*COLORS[ghost.color], 0.4))
        shown = times[times <= ghost.duration + 1 / RATE]
        for time, p, q in zip(shown.tolist(), *ghost.poses(shown)):
            meshcat.SetTransform(body, RigidTransform(Quaternion(q), p), time)
    meshcat.StopRecording()
    meshcat.PublishRecording()


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


def with_legend(page: str, ghosts: Iterable[Ghost]) -> str:
    """Returns a page of ghosts, HTML, with a legend that says which drone is which run."""
    rows = []
    for ghost in ghosts:
        r, g, b = (round(255 * share) for share in COLORS[ghost.color])
        best = ghost.run.result["best_lap_s"]
        words = ghost.run.folder.resolve().name + (f", best lap {best:.2f} s" if best else "")
        rows.append(
            f'<div><span style="color:rgb({r},{g},{b})">&#9679;</span> {escape(words)}</div>'
        )
    legend = (
        '<div style="position:absolute;left:12px;bottom:12px;padding:8px 12px;'
        "background:rgba(255,255,255,.85);color:#222;font:14px/1.5 sans-serif;"
        f'border-radius:6px">{"".join(rows)}</div>'
    )
    return page.replace("</body>", legend + "</body>", 1)
