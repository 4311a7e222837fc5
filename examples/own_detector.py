"""A detector of your own: it misses pictures, and you see what that does to the map.

    .venv/bin/python examples/own_detector.py [SEEN] [OF]

The detector finds markers in the camera's pictures; the mapper makes a map of them. Here, a
filter behind the detector lets only SEEN out of OF pictures through (default: 2 of 3). You see
the number of detections, the time of the exploration, and the error of the map over time, beside
those of a race without the filter. Then try 1 of 10: the map is a little worse, since the noise
of fewer detections is averaged; but the explorer waits for gates, and searches for them.

You learn how two systems take the place of one: as a Diagram whose ports have the same names.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import DiagramBuilder, LeafSystem

import airrace
from airrace.systems.perception.aruco_detector import ArucoDetector
from airrace.systems.types import Detections

SEEN, OF = (int(word) for word in sys.argv[1:3]) if len(sys.argv) > 2 else (2, 3)


class PictureFilter(LeafSystem):
    """Empties the detections of all but SEEN out of OF pictures."""

    def __init__(self, fps):
        """Args: fps: pictures a second (Hz)."""
        LeafSystem.__init__(self)
        self._fps = fps
        self._input = self.DeclareAbstractInputPort("all_detections", Value[object]())
        self.DeclareAbstractOutputPort(
            "detections",
            lambda: Value[object](Detections()),
            self._calc_detections,
            {self.all_input_ports_ticket()},
        )

    def _calc_detections(self, context, output):
        detections = self._input.Eval(context)
        # By the picture's time, not a counter: Drake may evaluate an output as often as it likes.
        seen = round(detections.time * self._fps) % OF < SEEN
        output.set_value(detections if seen else Detections(time=detections.time))


def make_detector(scenario):
    """Returns the detector and the filter in one Diagram, with the ports of a detector."""
    fps = scenario.camera.fps
    builder = DiagramBuilder()
    detector = builder.AddNamedSystem("detector", ArucoDetector(fps=fps))
    filter = builder.AddNamedSystem("filter", PictureFilter(fps))
    builder.Connect(detector.GetOutputPort("detections"), filter.GetInputPort("all_detections"))
    for name in ("camera_view", "camera_image_time", "camera_info"):
        builder.ExportInput(detector.GetInputPort(name), name)
    builder.ExportOutput(filter.GetOutputPort("detections"), "detections")
    return builder.Build()


MINE = {"systems": {"aruco_detector": "__main__:make_detector"}}
figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
for name, fields in {"all": {}, f"{SEEN} of {OF}": MINE}.items():
    run = airrace.race(track="hexagon", laps=1, record="light", quiet=True, fields=fields)
    if not run.result["finished"]:
        print(f"{name:8s} did not finish: {run.result['dnf_reason']}")
        continue
    error = run.map.groupby("time").error.agg(lambda e: np.sqrt(np.mean(e**2)))  # m, RMS
    print(
        f"{name:8s} {len(run.detections)} detections, explored in "
        f"{run.result['exploration']['time_s']:.1f} s, map {100 * error.iloc[-1]:.2f} cm off (RMS)"
    )
    axes.semilogy(error.index, 100 * error, label=name)
axes.set(xlabel="time (s)", ylabel="error of the map, RMS (cm)")
axes.legend(title="pictures seen")
figure.savefig("own_detector.png")
print(f"Picture: {Path('own_detector.png').resolve()}")
