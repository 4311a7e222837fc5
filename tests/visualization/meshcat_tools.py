"""What the tests of the live view share: pages without browsers."""

import msgpack
import numpy as np
from pydrake.common.value import Value
from pydrake.trajectories import PiecewisePolynomial

from airrace.systems.planning.lap_plan import LapPlan, PlanSummary
from airrace.trajopt.flat_trajectory import FlatTrajectory


def drawn(meshcat, path: str) -> dict:
    """Returns what a page is told to draw at a path."""
    return msgpack.unpackb(
        meshcat._GetPackedObject(path), strict_map_key=False, ext_hook=lambda code, data: data
    )


def transform(meshcat, path: str) -> list:
    """Returns the 16 numbers of a path's transform, column by column."""
    return msgpack.unpackb(meshcat._GetPackedTransform(path))["matrix"]


def fix(system, context, **values) -> None:
    """Fixes input ports; dots of their names are written as __."""
    for name, value in values.items():
        port = system.GetInputPort(name.replace("__", "."))
        is_object = type(value).__module__.startswith("airrace")
        port.FixValue(context, Value[object](value) if is_object else value)


class Watching:
    """An Audience that always waits, or never."""

    def __init__(self, watching: bool = True):
        self.watching = watching

    def waits(self) -> bool:
        return self.watching


def plan(lap: int, lap_time: float = 4.0, start_time: float = 0.0) -> LapPlan:
    """Returns a plan of laps on a level square of 10 m, with an entry that takes no time."""
    corners = np.array([[0.0, 0, 5, 0], [10, 0, 5, 1], [10, 10, 5, 2], [0, 10, 5, 3], [0, 0, 5, 4]])
    times = np.linspace(0.0, lap_time, len(corners))
    square = PiecewisePolynomial.CubicShapePreserving(times, corners.T)
    return LapPlan(
        lap=lap,
        start_time=start_time,
        entry=FlatTrajectory.resting(corners[0]),
        circuit=FlatTrajectory(square),
        phase=1e-3,
        summary=PlanSummary(),
    )
