"""SITL: the autonomy is in the same diagram as the simulation."""

from typing import TYPE_CHECKING

from airrace.diagrams.autonomy import MakeAutonomy
from airrace.hitl.transport import Transport

if TYPE_CHECKING:
    from pydrake.systems.analysis import Simulator
    from pydrake.systems.framework import Diagram, DiagramBuilder, System

    from airrace.scenario import Scenario


class InProcess(Transport):
    """The Transport of SITL."""

    simulation = "SITL"

    def AddToBuilder(
        self, builder: "DiagramBuilder", scenario: "Scenario", simulation: "Diagram"
    ) -> "System":
        autonomy = builder.AddSystem(MakeAutonomy(scenario))
        for source, sink in ((simulation, autonomy), (autonomy, simulation)):
            for i in range(sink.num_input_ports()):
                port = sink.get_input_port(i)
                builder.Connect(source.GetOutputPort(port.get_name()), port)
        return autonomy

    def advance(self, simulator: "Simulator", time: float) -> None:
        simulator.AdvanceTo(time)
