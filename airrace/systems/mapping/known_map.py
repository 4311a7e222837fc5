"""A map that is known before the race, in place of camera and mapper."""

from typing import Self

from pydrake.common.value import Value

from airrace.scenario import Scenario
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.types import Detections
from airrace.track.gate_map import GateMap
from airrace.track.map_files import read_map


class KnownMap(LeafSystem):
    """Outputs a map that never changes.

    .. pydrake_system::

        name: KnownMap
        output_ports:
        - gate_map

    It takes the GateMapper's place.
    """

    def __init__(self, gate_map: GateMap):
        """Args: gate_map: the map."""
        LeafSystem.__init__(self)
        self.DeclareAbstractOutputPort(
            "gate_map",
            lambda: Value[object](gate_map),
            lambda context, output: output.set_value(gate_map),
            {self.nothing_ticket()},
        )

    @classmethod
    def from_scenario(cls, scenario: Scenario) -> Self:
        """Returns the map that a scenario names."""
        return cls(read_map(scenario.map, scenario.track))


class NoDetector(LeafSystem):
    """Outputs no detections.

    .. pydrake_system::

        name: NoDetector
        output_ports:
        - detections

    It takes the ArucoDetector's place in a race with a KnownMap.
    """

    def __init__(self) -> None:
        LeafSystem.__init__(self)
        self.DeclareAbstractOutputPort(
            "detections",
            lambda: Value[object](Detections()),
            lambda context, output: output.set_value(Detections()),
            {self.nothing_ticket()},
        )
