"""The lap that the drone plans to fly, with its attitude, and those that it flew before."""

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import Meshcat, Rgba
from pydrake.systems.framework import LeafSystem

from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.trajopt.body_frames import body_frames
from airrace.visualization.arrows import frame_arrows
from airrace.visualization.tubes import faded, tube

# m; a well flown plan is around the flown path, and around the plans before it.
_RADIUS, _EARLIER_RADIUS = 0.14, 0.12
_IN_FORCE = Rgba(1.0, 1.0, 1.0, 0.4)
_ORANGE = (1.0, 0.5, 0.0)
_SAMPLE, _FINE = 0.1, 0.02  # s, of tubes and of body frames


class PlanVisualizer(LeafSystem):
    """Draws the plan in force in white, with arrows, and all before it in orange.

    .. pydrake_system::

        name: PlanVisualizer
        input_ports:
        - lap_plan

    ``lap_plan`` is a LapPlan or NO_PLAN.

    The arrows are the body's x and z axis along the lap, see body_frames(). The older an
    earlier plan is, the fainter it is; a plan that several laps flew is drawn once. Everything
    of a plan is below ``plans/lap_<the first lap flown on it>``: ``in_force``, and ``earlier``.
    When each of them is shown is part of a recording, but the opacities of a replay are those
    at its end.
    """

    def __init__(self, *, meshcat: Meshcat):
        """Args: meshcat: to draw in."""
        LeafSystem.__init__(self)
        self._meshcat = meshcat
        self._plan = self.DeclareAbstractInputPort("lap_plan", Value[object](NO_PLAN))
        self._drawn = NO_PLAN  # the newest; see PathVisualizer
        self._earlier = []  # paths of those before it, the oldest first
        self.DeclarePeriodicPublishEvent(0.1, 0.0, self._draw)

    def _draw(self, context):
        plan, old, now = self._plan.Eval(context), self._drawn, context.get_time()
        # Over a link, the same plan comes again and again, as another object.
        if (plan.lap, plan.start_time) == (old.lap, old.start_time):
            return
        self._drawn = plan
        if old is not NO_PLAN:
            self._retire(old, now)
        self._draw_in_force(plan, now)

    def _draw_in_force(self, plan, now):
        path = f"{_folder(plan)}/in_force"
        self._meshcat.SetTriangleMesh(f"{path}/path", *_tube(plan, _RADIUS), _IN_FORCE)
        times = np.linspace(0.0, plan.circuit.duration, _samples(plan.circuit.duration, _FINE))
        arrows = frame_arrows(body_frames(plan.circuit.sample(times)))
        self._meshcat.SetTriangleColorMesh(f"{path}/arrows", *arrows)
        self._show(path, now)

    def _retire(self, plan, now):
        """Turns a plan from white to orange, and makes all before it fainter."""
        self._meshcat.SetProperty(f"{_folder(plan)}/in_force", "visible", False, now)
        path = f"{_folder(plan)}/earlier"
        self._meshcat.SetTriangleMesh(path, *_tube(plan, _EARLIER_RADIUS), Rgba(*_ORANGE, faded(1)))
        self._show(path, now)
        self._earlier.append(path)
        for age, each in enumerate(reversed(self._earlier), start=1):
            self._meshcat.SetProperty(each, "opacity", faded(age))

    def _show(self, path, now):
        """Shows something from now on; in a replay, it is not there before."""
        self._meshcat.SetProperty(path, "visible", False, 0.0)
        self._meshcat.SetProperty(path, "visible", True, now)


def _folder(plan):
    return f"plans/lap_{plan.lap}"


def _samples(duration, period):
    return max(2, round(duration / period))


def _tube(plan, radius):
    """Returns the tubes around entry and circuit as one mesh, see tube()."""
    vertices, faces, count = [], [], 0
    for part in (plan.entry, plan.circuit):
        times = np.linspace(0.0, part.duration, _samples(part.duration, _SAMPLE))
        points, corners = tube(part.positions(times).T, radius)
        vertices.append(points)
        faces.append(corners + np.int32(count))
        count += points.shape[1]
    return np.hstack(vertices), np.hstack(faces)
