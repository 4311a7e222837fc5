"""How to find the gates of an unknown track. It flies as it is."""

from airrace.systems.exploring.explorer import Explorer


class MyExplorer(Explorer):
    """The shipped explorer, to begin with.

    Its `explorer_status` says which gates were found, in the order of flight, and when it is
    `done`. Then the planner plans the first lap.

    .. pydrake_system::

        name: MyExplorer
        input_ports:
        - detections
        - gate_map
        - state_estimate
        output_ports:
        - exploration_reference
        - explorer_status
    """

    def _calc_reference(self, context, output):
        """Writes where the drone should be now: position to snap, and yaw, (18,)."""
        Explorer._calc_reference(self, context, output)


def make(scenario):
    """Returns the system; called once before a race."""
    return MyExplorer.from_scenario(scenario)
