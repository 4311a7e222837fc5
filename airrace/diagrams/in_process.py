"""SITL: the autonomy is in the same diagram as the simulation."""

from airrace.diagrams.autonomy import MakeAutonomy


class InProcess:
    """The Transport of SITL; see airrace/hitl/transport.py for its methods."""

    simulation = "SITL"

    def AddToBuilder(self, builder, scenario, simulation):
        autonomy = builder.AddSystem(MakeAutonomy(scenario))
        for source, sink in ((simulation, autonomy), (autonomy, simulation)):
            for i in range(sink.num_input_ports()):
                port = sink.get_input_port(i)
                builder.Connect(source.GetOutputPort(port.get_name()), port)
        return autonomy

    def begin(self, simulator):
        pass

    def advance(self, simulator, time):
        simulator.AdvanceTo(time)

    def end(self, simulator):
        pass

    def wall(self, simulator):
        return {}

    def judged(self, status, simulator):
        return status
