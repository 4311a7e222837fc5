"""What a frame of the vtk renderer costs beside Drake's own camera on the same scene.

    python -m benchmarks.vtk_frame [--frames 20] [--json FILE]

Both draw the same views of the reference track by turns, each as a colour picture and
its depths; ours with haze and sky, once in colour and once in grey levels, as the
detector has it. The bare one is a RgbdSensor.
"""

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import RgbdSensor
from rich.console import Console
from rich.progress import track
from rich.table import Table

from airrace.common.errors import exit_code
from airrace.track import load_track
from benchmarks.perception_scenes import INFO, add_vtk_scene, look_at

BARE, COLOUR, GREY = "RgbdSensor, colour and depth", "airrace, colour", "airrace, grey levels"
LIMIT = 1.1  # times the bare one
_WARM_UP = 2  # frames that are not counted


def main(argv=None) -> int:
    """Draws the frames and prints the table; exit code 2 if there is no VTK."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=20, help="views of the track (default: 20)")
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    args = parser.parse_args(argv)
    result = measure(args.frames)
    Console(width=120).print(make_table(result))
    if args.json is not None:
        args.json.write_text(json.dumps(result, indent=1))
    return 0


def measure(frames: int = 20) -> dict:
    """Returns who draws to what each frame took (ms).

    Raises:
        UserError: if this machine cannot render with VTK.
    """
    race, builder = load_track("student-airrace"), DiagramBuilder()
    scene_graph, ours = add_vtk_scene(builder, race)
    sensor = builder.AddSystem(
        RgbdSensor(
            SceneGraph.world_frame_id(), RigidTransform(), ours.color_camera, ours.depth_camera
        )
    )
    builder.Connect(scene_graph.get_query_output_port(), sensor.query_object_input_port())
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(context))
    of_sensor = sensor.GetMyMutableContextFromRoot(context)
    pictures = {
        COLOUR: np.zeros((INFO.height, INFO.width, 4), np.uint8),
        GREY: np.zeros((INFO.height, INFO.width), np.uint8),
    }

    def bare(X_WC):
        sensor.SetX_PB(of_sensor, X_WC)
        sensor.color_image_output_port().Eval(of_sensor)
        sensor.depth_image_32F_output_port().Eval(of_sensor)

    painters = {BARE: bare} | {
        name: lambda X_WC, out=out: ours.render(X_WC, out, query) for name, out in pictures.items()
    }
    spent = {name: [] for name in painters}
    for k in track(range(_WARM_UP + frames), "Drawing", console=Console(stderr=True)):
        gate = race.gates[k % len(race.gates)]
        X_WC = look_at(gate.p_WG - (8.0 + k) * gate.forward, gate.p_WG)
        for name, paint in painters.items():
            clock = time.perf_counter()
            paint(X_WC)
            spent[name].append(1e3 * (time.perf_counter() - clock))
    return {name: times[_WARM_UP:] for name, times in spent.items()}


def make_table(result) -> Table:
    """Returns the table of what measure() returns."""
    table = Table(title=f"A frame of vtk, to take at most {LIMIT} times as long as the bare one")
    for name in ("", "median (ms)", "beside the bare one"):
        table.add_column(name, justify="left" if not name else "right")
    for name, times in result.items():
        share = np.median(np.divide(times, result[BARE]))
        table.add_row(name, f"{np.median(times):.1f}", f"{share:.2f}")
    return table


if __name__ == "__main__":
    sys.exit(exit_code(main))
