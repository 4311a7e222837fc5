"""The path that the drone has flown."""

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import Meshcat, Rgba, Sphere
from pydrake.math import RigidTransform
from pydrake.systems.framework import LeafSystem

from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.vehicle.state import as_plant_state
from airrace.visualization.meshcat_page import Audience
from airrace.visualization.tubes import faded, speed_colors, tube

HERE = "here"
_HERE_COLOR = Rgba(1.0, 0.9, 0.1, 0.35)
_MAX_SPEED = 20.0  # m/s, that is drawn red
_CHUNK = 30  # steps a mesh
_RADIUS = 0.09  # m


class PathVisualizer(LeafSystem):
    """Draws where the drone is and where it flew, coloured by its speed; earlier laps fainter.

    .. pydrake_system::

        name: PathVisualizer
        input_ports:
        - truth.state
        - lap_plan

    ``truth.state`` is the plant's floating-body state (13), ``lap_plan`` a LapPlan, which
    says when a new lap begins, or NO_PLAN. The path is drawn in pieces, so that a long race
    costs no more per point than a short one: each when it is complete, and while somebody
    watches, as it grows. A forced publish draws what is there. A translucent ball marks the
    drone, which is too small to see from afar.
    """

    def __init__(self, *, meshcat: Meshcat, audience: Audience | None = None):
        """Args: meshcat: to draw in. audience: of the page."""
        LeafSystem.__init__(self)
        self._meshcat = meshcat
        self._audience = audience or Audience(meshcat)
        self._state = self.DeclareVectorInputPort("truth.state", 13)
        self._plan = self.DeclareAbstractInputPort("lap_plan", Value[object](NO_PLAN))
        # What is on the page is output, not state: it depends on nothing but
        # the publishes so far, and nothing in the simulation depends on it.
        self._points, self._speeds = [], []  # of the newest piece
        self._lap, self._laps = 0, []  # that is flown, and that of every piece before the newest
        meshcat.SetObject(HERE, Sphere(0.8), _HERE_COLOR)
        self.DeclarePeriodicPublishEvent(0.1, 0.0, self._follow)
        self.DeclareForcedPublishEvent(lambda context: self._draw())

    def _follow(self, context):
        state = as_plant_state(self._state.Eval(context))
        p_WB = state.position.copy()
        self._meshcat.SetTransform(HERE, RigidTransform(p_WB), context.get_time())
        plan = self._plan.Eval(context)
        lap = 0 if plan is NO_PLAN else plan.lap_at(context.get_time())
        self._points.append(p_WB)
        self._speeds.append(float(np.linalg.norm(state.velocity)))
        if lap != self._lap:
            self._begin_piece()
            self._lap = lap
            self._fade()
        elif len(self._points) > _CHUNK:
            self._begin_piece()
        elif self._audience.waits():
            self._draw()

    def _begin_piece(self):
        """Draws the newest piece, and goes on with another one from its end."""
        self._draw()
        self._laps.append(self._lap)
        del self._points[:-1], self._speeds[:-1]

    def _fade(self):
        """Makes all earlier laps fainter."""
        for piece, lap in enumerate(self._laps):
            self._meshcat.SetProperty(f"flown/{piece}", "opacity", faded(self._lap - lap))

    def _draw(self):
        """Draws the newest piece."""
        if len(self._points) < 2:
            return
        vertices, faces = tube(self._points, _RADIUS)
        colors = np.repeat(speed_colors(self._speeds, _MAX_SPEED), 3, axis=0).T
        self._meshcat.SetTriangleColorMesh(f"flown/{len(self._laps)}", vertices, faces, colors)
