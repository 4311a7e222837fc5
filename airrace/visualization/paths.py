"""The path that the drone has flown, and the laps that it plans."""

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import Meshcat, Rgba, Sphere
from pydrake.math import RigidTransform
from pydrake.systems.framework import LeafSystem

from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.vehicle.state import as_plant_state
from airrace.visualization.meshcat_page import Audience
from airrace.visualization.tubes import speed_colors, tube

HERE = "here"
_HERE_COLOR = Rgba(1.0, 0.9, 0.1, 0.35)
_MAX_SPEED = 20.0  # m/s, that is drawn red
_CHUNK = 30  # points a mesh
_FLOWN_RADIUS, _PLAN_RADIUS = 0.09, 0.12  # m; a well flown plan is around the flown path
_CURRENT = Rgba(1.0, 1.0, 1.0, 0.35)
_EARLIER = (0.35, 0.25, 0.18, 0.1)  # opacity of the plans before it, newest first
_SAMPLE = 0.1  # s


class PathVisualizer(LeafSystem):
    """Draws where the drone is and where it flew, coloured by its speed.

    .. pydrake_system::

        name: PathVisualizer
        input_ports:
        - truth.state

    ``truth.state`` is the plant's floating-body state (13). The path is drawn in
    pieces, so that a long race costs no more per point than a short one: each when
    it is complete, and while somebody watches, as it grows. A forced publish draws
    what is there. A translucent ball marks the drone, which is too small to see from afar.
    """

    def __init__(self, *, meshcat: Meshcat, audience: Audience | None = None):
        """Args: meshcat: to draw in. audience: of the page."""
        LeafSystem.__init__(self)
        self._meshcat = meshcat
        self._audience = audience or Audience(meshcat)
        self._state = self.DeclareVectorInputPort("truth.state", 13)
        # What is on the page is output, not state: it depends on nothing but
        # the publishes so far, and nothing in the simulation depends on it.
        self._points, self._speeds = [], []
        meshcat.SetObject(HERE, Sphere(0.8), _HERE_COLOR)
        self.DeclarePeriodicPublishEvent(0.1, 0.0, self._follow)
        self.DeclareForcedPublishEvent(lambda context: self._draw())

    def _follow(self, context):
        state = as_plant_state(self._state.Eval(context))
        p_WB = state.position.copy()
        self._meshcat.SetTransform(HERE, RigidTransform(p_WB), context.get_time())
        self._points.append(p_WB)
        self._speeds.append(float(np.linalg.norm(state.velocity)))
        if (len(self._points) - 1) % _CHUNK == 0 or self._audience.waits():
            self._draw()

    def _draw(self):
        """Draws the newest piece."""
        count = len(self._points) - 1
        if count < 1:
            return
        first = (count - 1) // _CHUNK * _CHUNK
        vertices, faces = tube(self._points[first:], _FLOWN_RADIUS)
        colors = speed_colors(self._speeds[first:], _MAX_SPEED)
        self._meshcat.SetTriangleColorMesh(
            f"flown/{first // _CHUNK}", vertices, faces, np.repeat(colors, 3, axis=0).T
        )


class PlanVisualizer(LeafSystem):
    """Draws the plan in force, and in orange those before it, the older the fainter.

    .. pydrake_system::

        name: PlanVisualizer
        input_ports:
        - lap_plan

    ``lap_plan`` is a LapPlan or NO_PLAN.
    """

    def __init__(self, *, meshcat: Meshcat):
        """Args: meshcat: to draw in."""
        LeafSystem.__init__(self)
        self._meshcat = meshcat
        self._plan = self.DeclareAbstractInputPort("lap_plan", Value[object](NO_PLAN))
        self._drawn = [NO_PLAN]  # plans in their order; see PathVisualizer
        self.DeclarePeriodicPublishEvent(0.1, 0.0, self._draw)

    def _draw(self, context):
        plan = self._plan.Eval(context)
        if plan is self._drawn[-1]:
            return
        self._drawn.append(plan)
        newest = len(self._drawn) - 1
        self._draw_plan(newest, _CURRENT)
        for k, opacity in enumerate(_EARLIER, start=1):
            if newest - k > 0:
                self._draw_plan(newest - k, Rgba(1.0, 0.5, 0.0, opacity))
        if newest - len(_EARLIER) > 1:
            self._meshcat.Delete(f"planned/{newest - len(_EARLIER) - 1}")

    def _draw_plan(self, number: int, color: Rgba) -> None:
        plan = self._drawn[number]
        for name, part in (("entry", plan.entry), ("circuit", plan.circuit)):
            times = np.linspace(0.0, part.duration, max(2, round(part.duration / _SAMPLE)))
            vertices, faces = tube(part.sample(times)[:3].T, _PLAN_RADIUS)
            self._meshcat.SetTriangleMesh(f"planned/{number}/{name}", vertices, faces, color)
