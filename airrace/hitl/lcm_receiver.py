"""Ports whose values come over LCM."""

from pydrake.common.value import Value
from pydrake.systems.framework import LeafSystem

from airrace.common.immutable import Immutable


class LcmReceiver(LeafSystem):
    """Holds the values of the last message of a channel.

    .. pydrake_system::

        name: LcmReceiver
        output_ports:
        - the ports of the channel
        - the first of them, with _time added

    It is the counterpart of an LcmSender on the other side of the link: its output
    ports have the names and types of that one's input ports. They show
    the state, which receive() sets between two steps of the Simulator, so that
    all systems see the same message within a step. The last port, a vector of one
    number, is the simulated time at which that was sent (s).
    """

    def __init__(self, channel):
        """Args: channel: a PortChannel."""
        LeafSystem.__init__(self)
        self.channel = channel.name
        self._state = self.DeclareAbstractState(Value[object](_Values(channel.initial, 0.0)))
        ticket = {self.abstract_state_ticket(self._state)}
        for port in channel.ports:
            model = channel.model(port)
            if isinstance(model, int):
                self.DeclareVectorOutputPort(port, model, self._calc(port), ticket)
            else:
                self.DeclareAbstractOutputPort(port, model.Clone, self._calc(port), ticket)
        time_port = f"{channel.ports[0]}_time"
        self.DeclareVectorOutputPort(time_port, 1, self._calc_time, ticket)

    def receive(self, context, values: dict, time: float) -> None:
        """Shows other values, by port, that were sent at a simulated time (s)."""
        context.SetAbstractState(int(self._state), _Values(values, time))

    def _values(self, context) -> "_Values":
        return context.get_abstract_state(int(self._state)).get_value()

    def _calc(self, port):
        return lambda context, output: output.set_value(self._values(context).by_port[port])

    def _calc_time(self, context, output):
        output.SetAtIndex(0, self._values(context).time)


class _Values(Immutable):
    """The values of all ports, and when they were sent; shared by copies of a Context."""

    def __init__(self, by_port: dict, time: float):
        self.by_port, self.time = by_port, time
