"""A race with a system in its diagram that writes signals down, without a file."""

from collections.abc import Callable

from pydrake.systems.framework import LeafSystem, System

from airrace.diagrams.in_process import InProcess


class LoggedInProcess(InProcess):
    """SITL with a log, whose input ports are named as those that they show.

    Of a name that both have, such as ``state_estimate``, it shows the autonomy's.

    Attributes:
        log: that of the race.
    """

    log: LeafSystem

    def __init__(self, make_log: Callable[[System], LeafSystem]):
        """Args: make_log: returns the log, beside an autonomy."""
        self._make_log = make_log

    def AddToBuilder(self, builder, scenario, simulation):
        autonomy = super().AddToBuilder(builder, scenario, simulation)
        self.log = builder.AddSystem(self._make_log(autonomy))
        for i in range(self.log.num_input_ports()):
            port = self.log.get_input_port(i)
            name = port.get_name()
            source = autonomy if autonomy.HasOutputPort(name) else simulation
            builder.Connect(source.GetOutputPort(name), port)
        return autonomy
