"""The attitude of the laps that the drone plans to fly."""

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import Meshcat

from airrace.systems.leaf_system import LeafSystem
from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.trajopt.body_frames import body_frames
from airrace.visualization.arrows import frame_arrows

_STEP = 0.02  # s, between two samples that body frames are chosen from


class PlanVisualizer(LeafSystem):
    """Draws the body's x and z axis along every plan as arrows, see body_frames().

    .. pydrake_system::

        name: PlanVisualizer
        input_ports:
        - lap_plan

    ``lap_plan`` is a LapPlan or NO_PLAN.

    Those of a plan are at ``plans/lap_<the first lap flown on it>``. The page shows the ones
    of the plan in force, and draws the lines of all plans itself.
    """

    def __init__(self, *, meshcat: Meshcat):
        """Args: meshcat: to draw in."""
        LeafSystem.__init__(self)
        self._meshcat = meshcat
        self._plan = self.DeclareAbstractInputPort("lap_plan", Value[object](NO_PLAN))
        # What is on the page is output, not state: it depends on nothing but
        # the publishes so far, and nothing in the simulation depends on it.
        self._drawn = NO_PLAN  # the newest
        self.DeclarePeriodicPublishEvent(0.1, 0.0, self._draw)

    def _draw(self, context):
        plan, old = self._plan.Eval(context), self._drawn
        # Over a link, the same plan comes again and again, as another object.
        if (plan.lap, plan.start_time) == (old.lap, old.start_time):
            return
        self._drawn = plan
        count = max(2, round(plan.circuit.duration / _STEP))
        times = np.linspace(0.0, plan.circuit.duration, count)
        arrows = frame_arrows(body_frames(plan.circuit.sample(times)))
        self._meshcat.SetTriangleColorMesh(f"plans/lap_{plan.lap}", *arrows)
