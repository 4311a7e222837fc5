"""Turns the plan in force into the controller's reference."""

from pydrake.common.value import Value

from airrace.systems.leaf_system import LeafSystem
from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.systems.planning.path_clock import CLOCK_SIZE, REGULAR_VECTOR, as_clock
from airrace.systems.ports import read_or, read_vector
from airrace.systems.types import LAND
from airrace.trajopt.reference import REFERENCE_SIZE


class TrajectoryTracker(LeafSystem):
    """Evaluates the lap plan; before there is one, passes the explorer's on.

    .. pydrake_system::

        name: TrajectoryTracker
        input_ports:
        - lap_plan
        - exploration_reference
        - explorer_status (may be left open: it never lands)
        - path_clock (may be left open: plans never wait)
        output_ports:
        - reference

    ``lap_plan`` is a LapPlan or NO_PLAN, ``explorer_status`` an ExplorerStatus: if that says that
    the drone has to land, it is the explorer's reference again. The references (18) are laid out in
    trajopt/reference.py: position to snap in the world, then yaw and
    its first two derivatives. ``path_clock`` is the vector of a PathClock (6): see PathGovernor.
    """

    def __init__(self) -> None:
        """Constructs the tracker."""
        LeafSystem.__init__(self)
        self._plan = self.DeclareAbstractInputPort("lap_plan", Value[object](NO_PLAN))
        self._exploration = self.DeclareVectorInputPort("exploration_reference", REFERENCE_SIZE)
        self._explorer = self.DeclareAbstractInputPort("explorer_status", Value[object]())
        self._clock = self.DeclareVectorInputPort("path_clock", CLOCK_SIZE)
        self.DeclareVectorOutputPort("reference", REFERENCE_SIZE, self._calc_reference)

    def _calc_reference(self, context, output):
        plan = self._plan.Eval(context)
        explorer = self._explorer
        lands = explorer.HasValue(context) and explorer.Eval(context).state == LAND
        if plan is NO_PLAN or lands:
            output.set_value(read_vector(self._exploration, context))
        else:
            clock = as_clock(read_or(REGULAR_VECTOR, self._clock, context))
            output.set_value(clock.reference(plan, context.get_time()))
