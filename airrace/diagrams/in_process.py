"""SITL: the autonomy is in the same diagram as the simulation."""

from typing import TYPE_CHECKING

from airrace.diagrams.autonomy import MakeAutonomy
from airrace.diagrams.transport import Transport
from airrace.diagrams.wiring import connect_by_name, outputs_of

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
        connect_by_name(builder, [autonomy], outputs_of(simulation))
        connect_by_name(builder, [simulation], outputs_of(autonomy))
        return autonomy

    def advance(self, simulator: "Simulator", time: float) -> None:
        simulator.AdvanceTo(time)
