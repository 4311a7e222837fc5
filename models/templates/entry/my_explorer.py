"""How to find the gates of an unknown track. It flies as it is."""

from airrace.systems.exploring.explorer import Explorer
from airrace.track import load_track
from airrace.trajopt.feasibility import clearance_of
from airrace.vehicle import load_vehicle


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
    vehicle, _ = load_vehicle(scenario.drone)
    return MyExplorer(
        config=scenario.explorer,
        # All that the track's file tells: its gates are not those of the race.
        hover_height=load_track(scenario.track).hover_height,
        clearance=clearance_of(vehicle.radius),
    )
