"""Ports whose values come over LCM."""

from pydrake.common.value import Value
from pydrake.systems.framework import LeafSystem

from airrace.common.immutable import Immutable


class LcmReceiver(LeafSystem):
    """Holds the values of the last message of a channel.

    .. pydrake_system::

        name: LcmReceiver
        output_ports:
        - the ports of the row
        - the first of them, with _time added

    It is the counterpart of an LcmSender on the other side of the link: its output
    ports have the names and types of that one's input ports. What they show is
    the state, which Receive() sets between two steps of the Simulator, so that
    within a step everybody sees the same message. The last port, a vector of one
    number, is the simulated time at which that was sent (s).
    """

    def __init__(self, row):
        """Args: row: of hitl/channels.py."""
        LeafSystem.__init__(self)
        self._row = row
        self._shown = self.DeclareAbstractState(Value[object](_Values(row.initial, 0.0)))
        ticket = {self.abstract_state_ticket(self._shown)}
        for port in row.ports:
            model = row.model(port)
            if isinstance(model, int):
                self.DeclareVectorOutputPort(port, model, self._calc(port), ticket)
            else:
                self.DeclareAbstractOutputPort(port, model.Clone, self._calc(port), ticket)

        self.DeclareVectorOutputPort(
            f"{row.ports[0]}_time",
            1,
            lambda context, output: output.SetAtIndex(0, self._now(context).time),
            ticket,
        )

    @property
    def channel(self) -> str:
        """That it holds the values of."""
        return self._row.name

    def receive(self, context, values: dict, time: float) -> None:
        """Shows other values, by port, that were sent at a simulated time (s)."""
        context.SetAbstractState(int(self._shown), _Values(values, time))

    def _now(self, context):
        return context.get_abstract_state(int(self._shown)).get_value()

    def _calc(self, port):
        return lambda context, output: output.set_value(self._now(context).by_port[port])


class _Values(Immutable):
    """The values of all ports, and when they were sent; shared by copies of a Context."""

    def __init__(self, by_port: dict, time: float):
        self.by_port, self.time = by_port, time
