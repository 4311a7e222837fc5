"""From the plan in force to what the controller follows. It flies as it is."""

from pydrake.common.value import Value
from pydrake.systems.framework import LeafSystem

from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.systems.ports import read_vector
from airrace.trajopt.reference import REFERENCE_SIZE


class MyTracker(LeafSystem):
    """Passes the explorer's reference on until there is a plan, then the plan's.

    .. pydrake_system::

        name: MyTracker
        input_ports:
        - lap_plan
        - exploration_reference
        output_ports:
        - reference
    """

    def __init__(self):
        """Declares the ports; their names say what they are connected to."""
        LeafSystem.__init__(self)
        self._plan = self.DeclareAbstractInputPort("lap_plan", Value[object](NO_PLAN))
        self._exploration = self.DeclareVectorInputPort("exploration_reference", REFERENCE_SIZE)
        self.DeclareVectorOutputPort("reference", REFERENCE_SIZE, self._calc_reference)

    def _calc_reference(self, context, output):
        """Writes position to snap, and yaw with its derivatives, (18,)."""
        plan = self._plan.Eval(context)
        if plan is NO_PLAN:
            output.set_value(read_vector(self._exploration, context))
        else:
            output.set_value(plan.reference(context.get_time()))


def make(scenario):
    """Returns the system; called once before a race."""
    return MyTracker()
