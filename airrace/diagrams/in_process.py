"""SITL: the autonomy is in the same diagram as the simulation."""

from airrace.diagrams.autonomy import MakeAutonomy
from airrace.hitl.transport import Transport


class InProcess(Transport):
    """The Transport of SITL."""

    simulation = "SITL"

    def AddToBuilder(self, builder, scenario, simulation):
        autonomy = builder.AddSystem(MakeAutonomy(scenario))
        for source, sink in ((simulation, autonomy), (autonomy, simulation)):
            for i in range(sink.num_input_ports()):
                port = sink.get_input_port(i)
                builder.Connect(source.GetOutputPort(port.get_name()), port)
        return autonomy

    def advance(self, simulator, time):
        simulator.AdvanceTo(time)
