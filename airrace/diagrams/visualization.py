"""The race in Drake's Meshcat: flown and planned paths beside the scene."""

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import Meshcat, MeshcatParams, Rgba, Sphere
from pydrake.math import RigidTransform
from pydrake.systems.framework import LeafSystem

from airrace.rendering.daylight import SetDaylight
from airrace.systems.lap_plan import NO_PLAN

_FLOWN = Rgba(0.1, 0.5, 1.0, 1.0)
_PLANNED = Rgba(1.0, 0.5, 0.0, 1.0)
_HERE = Rgba(1.0, 0.9, 0.1, 0.35)
_CHUNK = 60  # points a line object


def MakeMeshcat(track) -> Meshcat:
    """Starts a Meshcat server on loopback, looking at the track.

    Args:
        track: the airrace.track.Track.

    Raises:
        RuntimeError: if no port is free.
    """
    meshcat = Meshcat(MeshcatParams(host="localhost", show_stats_plot=False))
    feet = track.pylons()
    middle = feet.mean(axis=0)
    size = np.ptp(feet[:, :2], axis=0).max()
    meshcat.SetCameraPose(middle + [-0.35 * size, -0.6 * size, 0.5 * size], middle)
    SetDaylight(meshcat)
    meshcat.SetProperty("/Cameras/default/rotated/<object>", "far", 1000.0)
    meshcat.SetProperty("/Grid", "visible", False)
    meshcat.SetProperty("/Axes", "visible", False)
    return meshcat


class PathVisualizer(LeafSystem):
    """Draws where the drone is, where it flew and what it plans to fly.

    .. pydrake_system::

        name: PathVisualizer
        input_ports:
        - truth.state
        - lap_plan

    ``truth.state`` is the plant's floating-body state (13), ``lap_plan`` a
    LapPlan or NO_PLAN. The flown path is drawn in pieces, so that a long race
    costs no more per point than a short one. A translucent ball around the
    drone shows where to look: from afar, half a metre is too small to see.
    """

    def __init__(self, *, meshcat: Meshcat, period: float = 0.1):
        """Args: meshcat: to draw in. period: between two points (s)."""
        LeafSystem.__init__(self)
        self._meshcat = meshcat
        self._state = self.DeclareVectorInputPort("truth.state", 13)
        self._plan = self.DeclareAbstractInputPort("lap_plan", Value[object](NO_PLAN))
        # What is on the page is output, not state: it depends on nothing but
        # the publishes so far, and nothing in the simulation depends on it.
        self._points = []
        self._drawn_plan = None
        meshcat.SetObject("here", Sphere(0.8), _HERE)
        self.DeclarePeriodicPublishEvent(period, 0.0, self._Draw)

    def _Draw(self, context):
        p_WB = self._state.Eval(context)[4:7].copy()
        self._meshcat.SetTransform("here", RigidTransform(p_WB), context.get_time())
        self._points.append(p_WB)
        count = len(self._points) - 1
        if count > 0:
            first = (count - 1) // _CHUNK * _CHUNK
            vertices = np.array(self._points[first:]).T
            self._meshcat.SetLine(f"flown/{first // _CHUNK}", vertices, 3.0, _FLOWN)
        plan = self._plan.Eval(context)
        if plan is not NO_PLAN and plan is not self._drawn_plan:
            self._drawn_plan = plan
            for name, part in (("entry", plan.entry), ("circuit", plan.circuit)):
                times = np.linspace(0.0, part.duration, 300)
                self._meshcat.SetLine(f"planned/{name}", part.sample(times)[:3], 2.0, _PLANNED)


def AddVisualization(builder, simulation, autonomy, meshcat: Meshcat) -> PathVisualizer:
    """Adds the paths of a race to its Meshcat.

    Args:
        builder: of the race.
        simulation, autonomy: the two diagrams in it.
        meshcat: that the simulation draws its scene in.
    """
    paths = builder.AddNamedSystem("path_visualizer", PathVisualizer(meshcat=meshcat))
    builder.Connect(simulation.GetOutputPort("truth.state"), paths.GetInputPort("truth.state"))
    builder.Connect(autonomy.GetOutputPort("lap_plan"), paths.GetInputPort("lap_plan"))
    return paths
