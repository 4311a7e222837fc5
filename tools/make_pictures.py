"""Makes the README's pictures from a real run: python -m tools.make_pictures.

Flies one lap of the reference track, and draws it with VTK from behind the drone and from
above, with what its camera sees and the race's splits. Needs what `--renderer vtk` needs.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image
from pydrake.common import MemoryFile
from pydrake.common.eigen_geometry import Quaternion
from pydrake.geometry import GeometryInstance, InMemoryMesh, Mesh, PerceptionProperties, Rgba
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder
from rich.progress import track as progress

from airrace.common.colors import speed_colors
from airrace.common.errors import exit_code
from airrace.rendering.planar.renderer import PlanarRenderer
from airrace.rendering.scene.scenery import AddScenery
from airrace.rendering.vtk.vtk_renderer import AddVtkRenderer
from airrace.systems.types import ExplorerStatus, make_camera_info
from airrace.vehicle import CameraMount, load_vehicle
from airrace.visualization.meshcat_page import overview
from airrace.visualization.tubes import tube
from tools.scoreboard import Moment, draw_lines, scoreboard_lines

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "pictures"
_COLORS = 12  # of the path
_NEAR, _FAR = 0.05, 0.2  # m, its radius seen from near and from far
_MAX_SPEED = 20.0  # m/s, at the end of the scale
_FPS, _SPEED = 10.0, 2.0  # frames a second, and seconds of the race a second
_BEHIND, _ABOVE, _LAG = 4.5, 1.6, 0.5  # m, m, s: of the chasing camera


def fly(folder: Path):
    """Flies the race; returns its Run."""
    from airrace.analysis import load_run
    from airrace.diagrams.race import run_race
    from airrace.scenario import load_scenario

    scenario = load_scenario(scenario_text="{laps: 1}")
    with progress_bar("Flying") as show:
        run_race(scenario, folder, show=show)
    return load_run(folder)


def progress_bar(what: str):
    """Returns a context manager of a callback of run_race() that shows a clock."""
    from rich.console import Console
    from rich.status import Status

    class Clock(Status):
        def __enter__(self):
            super().__enter__()
            return lambda record, look: self.update(f"{what}: {look.time:.0f} s simulated")

    return Clock(what, console=Console(stderr=True))


class Scene:
    """The world with the drone of a run, to be drawn at any time of it."""

    def __init__(self, run, size, radius: float):
        """Args: run: see load_run(). size: of pictures (px). radius: of lap 1's path (m)."""
        self._run = run
        self._state = run.state
        builder = DiagramBuilder()
        self._plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
        AddScenery(self._plant, run.track)
        _, sdf = load_vehicle(run.scenario.drone)
        Parser(self._plant).AddModels(str(sdf))
        self._draw_path(radius)
        self._plant.Finalize()
        width, height = size
        info = make_camera_info(
            width=width, height=height, fov_y=np.deg2rad(60.0), X_BC=CameraMount().X_BC
        )
        self._renderer = AddVtkRenderer(scene_graph, info, supersampling=2)
        diagram = builder.Build()
        self._context = diagram.CreateDefaultContext()
        self._query = scene_graph.get_query_output_port()
        self._query_context = scene_graph.GetMyContextFromRoot(self._context)
        self._size = size

    def _draw_path(self, radius):
        rows = np.flatnonzero(np.asarray(self._state["lap"]) == 1)[::5]
        points = np.column_stack([self._state[c][rows] for c in "xyz"])
        speeds = np.asarray(self._state["speed"])[rows]
        bins = np.minimum((speeds / _MAX_SPEED * _COLORS).astype(int), _COLORS - 1)
        for k, part in enumerate(np.split(np.arange(len(rows)), np.flatnonzero(np.diff(bins)) + 1)):
            way = points[part[0] : part[-1] + 2]
            if len(way) < 2:
                continue
            vertices, faces = tube(way, radius)
            lines = [f"v {x:.4f} {y:.4f} {z:.4f}" for x, y, z in vertices.T]
            lines += [
                f"vn {x:.3f} {y:.3f} {z:.3f}"
                for x, y, z in (vertices.T - np.repeat(way, 3, axis=0)) / radius
            ]
            lines += ["f " + " ".join(f"{v}//{v}" for v in face + 1) for face in faces.T]
            file = MemoryFile("\n".join(lines) + "\n", ".obj", f"path_{k}")
            instance = GeometryInstance(
                RigidTransform(), Mesh(InMemoryMesh(mesh_file=file)), f"path_{k}"
            )
            properties = PerceptionProperties()
            color = speed_colors([speeds[part].mean()], _MAX_SPEED)[0]
            properties.AddProperty("phong", "diffuse", Rgba(*color, 1.0))
            instance.set_perception_properties(properties)
            self._plant.RegisterVisualGeometry(self._plant.world_body(), instance)

    def pose(self, time) -> tuple:
        """Returns X_WB and the speed (m/s) at a time (s)."""
        k = min(np.searchsorted(self._state["time"], time), len(self._state["time"]) - 1)
        q = np.array([self._state[c][k] for c in ("qw", "qx", "qy", "qz")], float)
        p_WB = np.array([self._state[c][k] for c in "xyz"], float)
        speed = float(self._state["speed"][k])
        return RigidTransform(Quaternion(q / np.linalg.norm(q)), p_WB), speed

    def draw(self, time, X_WC) -> np.ndarray:
        """Returns a picture from X_WC, RGB, (h, w, 3)."""
        X_WB, _ = self.pose(time)
        context = self._plant.GetMyMutableContextFromRoot(self._context)
        self._plant.SetFloatingBaseBodyPoseInWorldFrame(
            context, self._plant.GetBodyByName("body"), X_WB
        )
        picture = np.zeros((self._size[1], self._size[0], 4), np.uint8)
        self._renderer.render(X_WC, picture, self._query.Eval(self._query_context))
        return picture[..., :3].copy()


def look_at(eye, target) -> RigidTransform:
    """Returns the pose of a level camera at a place, with a target in its middle."""
    z = (target - eye) / np.linalg.norm(target - eye)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    return RigidTransform(RotationMatrix(np.column_stack([x, np.cross(z, x), z])), eye)


def lines_at(run, time, speed) -> list:
    """Returns the lines of the scoreboard of a run at a time (s)."""
    from airrace.systems.types import GateCrossing, RefereeStatus

    lap, crossings = run.result["laps"][0], []
    gate_times = [*lap["gate_times_s"], lap["time_s"]]
    for k, t in enumerate(lap["start_s"] + np.array(gate_times)):
        if t <= time:
            crossings.append(GateCrossing(t, k % len(run.track.gates) + 1, 1, 0.0, 0.0))
    over = len(crossings) == len(gate_times)
    report = RefereeStatus(tuple(crossings), over, None, time if over else None, 0)
    moment = Moment(time, speed, report, ExplorerStatus(done=True))
    return scoreboard_lines(moment, len(run.track.gates), 1)


def overlay(picture, inset, left, top) -> None:
    """Puts a picture on another."""
    h, w = inset.shape[:2]
    picture[top : top + h, left : left + w] = inset


def animation(run, path: Path, size=(600, 338)) -> None:
    """Writes a lap from behind the drone as an animated WebP."""
    lap = run.result["laps"][0]
    scene = Scene(run, size, _NEAR)
    vehicle, _ = load_vehicle(run.scenario.drone)
    eye = make_camera_info(width=176, height=99, fov_y=np.deg2rad(55.95), X_BC=vehicle.camera.X_BC)
    renderer, inset = PlanarRenderer(run.track, eye), np.zeros((99, 176, 4), np.uint8)
    times = np.arange(lap["start_s"], lap["start_s"] + lap["time_s"], _SPEED / _FPS)
    forward, frames = None, []
    for time in progress(times, "Drawing"):
        X_WB, speed = scene.pose(time)
        heading = X_WB.rotation().matrix()[:, 0] * [1.0, 1.0, 0.0]
        share = 1.0 - np.exp(-_SPEED / _FPS / _LAG)
        forward = heading if forward is None else forward + share * (heading - forward)
        p_WB = X_WB.translation()
        frame = scene.draw(time, look_at(p_WB - _BEHIND * forward + [0, 0, _ABOVE], p_WB))
        renderer.render(X_WB @ eye.X_BC, inset)
        overlay(frame, inset[..., :3], 10, size[1] - 109)
        board = draw_lines(lines_at(run, time, speed))
        small = Image.fromarray(board).resize((board.shape[1] * 5 // 9, board.shape[0] * 5 // 9))
        overlay(frame, np.asarray(small), 10, 10)
        frames.append(Image.fromarray(frame))
    frames[0].save(
        path,
        save_all=True,
        append_images=frames[1:],
        duration=round(1000 / _FPS),
        loop=0,
        quality=35,
        method=6,
    )


def still(run, path: Path, size=(1280, 720)) -> None:
    """Writes a lap from above."""
    lap = run.result["laps"][0]
    time = lap["start_s"] + 0.999 * lap["time_s"]
    scene = Scene(run, size, _FAR)
    picture = scene.draw(time, look_at(*overview(run.track)))
    end = lap["start_s"] + lap["time_s"]
    overlay(picture, draw_lines(lines_at(run, end, scene.pose(time)[1])), 16, 16)
    Image.fromarray(picture).save(path, quality=80, method=6)


def run(args) -> int:
    """Makes the pictures; returns the exit code."""
    from airrace.analysis import load_run

    args.output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        flown = load_run(args.run) if args.run else fly(Path(folder))
        still(flown, args.output / "track.webp")
        animation(flown, args.output / "race.webp")
    for path in sorted(args.output.iterdir()):
        print(f"{path.name}: {path.stat().st_size / 1e3:.0f} kB")
    return 0


def main(argv=None) -> int:
    """The command-line program; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="tools.make_pictures",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--run", type=Path, help="draw this run's first lap instead of flying one")
    parser.add_argument("--output", type=Path, default=FOLDER, help="default: docs/pictures")
    args = parser.parse_args(argv)
    return exit_code(lambda: run(args))


if __name__ == "__main__":
    sys.exit(main())
