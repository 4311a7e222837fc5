"""What a frame of the vtk renderer costs beside Drake's own camera on the same scene.

    python -m benchmarks.vtk_frame [--frames 20] [--json FILE]

Both draw the same views of the track student-airrace by turns. Drake's RgbdSensor draws a colour
picture and its depths; the vtk renderer draws these, and haze and sky, once in colour and
once in grey levels, as the detector gets it.
"""

import sys
import time

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import RgbdSensor

from airrace.track import load_track
from benchmarks import harness
from benchmarks.perception_scenes import INFO, add_vtk_scene
from tests.worlds.pictures import look_at

_BARE, _COLOUR, _GREY = "RgbdSensor, colour and depth", "airrace, colour", "airrace, grey levels"
_LIMIT = 1.1  # times the bare one
_WARM_UP = 2  # frames that are not counted


def main(argv=None) -> int:
    """Draws the frames and prints the table; exit code 2 if there is no VTK."""
    parser = harness.make_parser(__doc__)
    parser.add_argument(
        "--frames", type=harness.count, default=20, help="views of the track (default: 20)"
    )
    return harness.run(
        parser, argv, lambda args: measure(args.frames), lambda result: ([make_table(result)], True)
    )


def measure(frames: int = 20) -> dict:
    """Returns renderer to what each frame took (ms).

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
    sensor_context = sensor.GetMyMutableContextFromRoot(context)
    colour = np.zeros((INFO.height, INFO.width, 4), np.uint8)
    grey = np.zeros((INFO.height, INFO.width), np.uint8)

    def bare(X_WC):
        sensor.SetX_PB(sensor_context, X_WC)
        sensor.color_image_output_port().Eval(sensor_context)
        sensor.depth_image_32F_output_port().Eval(sensor_context)

    renderers = {
        _BARE: bare,
        _COLOUR: lambda X_WC: ours.render(X_WC, colour, query),
        _GREY: lambda X_WC: ours.render(X_WC, grey, query),
    }
    spent = {name: [] for name in renderers}
    for k in harness.progress(range(_WARM_UP + frames), "Drawing"):
        gate = race.gates[k % len(race.gates)]
        X_WC = look_at(gate.p_WG - (8.0 + k) * gate.forward, gate.p_WG)
        for name, render in renderers.items():
            clock = time.perf_counter()
            render(X_WC)
            spent[name].append(1e3 * (time.perf_counter() - clock))
    return {name: times[_WARM_UP:] for name, times in spent.items()}


def make_table(result: dict):
    """Returns the table of what measure() returns."""
    columns = {"": "{name}", "median (ms)": "{ms:.1f}", "beside the bare one": "{ratio:.2f}"}
    rows = [
        {"name": name, "ms": np.median(ms), "ratio": np.median(np.divide(ms, result[_BARE]))}
        for name, ms in result.items()
    ]
    title = f"A frame of vtk, to take at most {_LIMIT} times as long as the bare one"
    return harness.make_table(title, rows, columns)


if __name__ == "__main__":
    sys.exit(main())
