"""Where the autonomy of a race is: here, or at the other end of a link."""

from airrace.diagrams.autonomy import MakeAutonomy

LOOK_PERIOD = 0.1  # s of simulated time between looks at the race


class InProcess:
    """SITL: the autonomy is in the same diagram as the simulation.

    See remote.py for those of HITL, which have the same methods.
    """

    simulation = "SITL"

    def AddTo(self, builder, scenario, simulation):
        """Adds the autonomy to a race.

        Args:
            builder: of the race, with the simulation in it.
            scenario: the race.
            simulation: the diagram.

        Returns:
            a diagram with the autonomy's output ports.
        """
        autonomy = builder.AddSystem(MakeAutonomy(scenario))
        for source, sink in ((simulation, autonomy), (autonomy, simulation)):
            for i in range(sink.num_input_ports()):
                port = sink.get_input_port(i)
                builder.Connect(source.GetOutputPort(port.get_name()), port)
        return autonomy

    def begin(self, simulator) -> None:
        """Starts the race; the simulator is initialized."""

    def advance(self, simulator, time: float) -> str | None:
        """Advances to a simulated time (s); returns why the race cannot go on, or None."""
        simulator.AdvanceTo(time)

    def end(self, simulator) -> None:
        """Says farewell, also when something went wrong."""

    def wall(self, simulator) -> dict:
        """Returns what belongs below `wall` in race.json."""
        return {}

    def judged(self, report, simulator):
        """Returns the referee's report, with what only the link knows of it."""
        return report
