"""Ports whose values come over LCM."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import AbstractStateIndex, Context

from airrace.common.immutable import Immutable
from airrace.systems.leaf_system import LeafSystem

if TYPE_CHECKING:
    from airrace.hitl.channels import PortChannel
    from airrace.hitl.link.endpoint import Endpoint
    from airrace.hitl.link.packets import Stamp


class LcmReceiver(LeafSystem):
    """Holds the values of the last message of each channel of the other side.

    .. pydrake_system::

        name: LcmReceiver
        output_ports:
        - the ports of each channel
        - the first of them, with _time added

    It stands for the diagram on the other side of the link: its output ports have the
    names and types of that one's. They show the state, which receive() sets between two
    steps of the Simulator, so that all systems see the same messages within a step. The
    last port of a channel, a vector of one number, is the simulated time at which its
    message was sent (s).
    """

    def __init__(self, channels: "Sequence[PortChannel]", role: str):
        """Args: channels: PortChannels of the race. role: of this side."""
        LeafSystem.__init__(self)
        self._states = {}  # name of a channel to its abstract state and the port of the time
        for channel in channels:
            if channel.sender == role or channel.ports[0].startswith("truth."):
                continue
            time_port = f"{channel.ports[0]}_time"
            initial = _Values({**channel.initial, time_port: np.zeros(1)}, None)
            state = int(self.DeclareAbstractState(Value[object](initial)))
            self._states[channel.name] = state, time_port
            for port in channel.ports:
                self._declare(port, channel.model(port), state)
            self._declare(time_port, 1, state)

    def _declare(self, port, model, state):
        def calc(context, output):
            output.set_value(_values(context, state).by_port[port])

        ticket = {self.abstract_state_ticket(AbstractStateIndex(state))}
        if isinstance(model, int):
            self.DeclareVectorOutputPort(port, model, calc, ticket)
        else:
            self.DeclareAbstractOutputPort(port, model.Clone, calc, ticket)

    def receive(self, root_context: Context, endpoint: "Endpoint") -> None:
        """Shows the newest values that have come.

        Args:
            root_context: of the diagram that is simulated.
            endpoint: that has drained what came.
        """
        context = self.GetMyMutableContextFromRoot(root_context)
        for channel, (state, time_port) in self._states.items():
            received = endpoint.newest(channel, context.get_time())
            if received is not None and received.stamp is not _values(context, state).stamp:
                values = {**received.value, time_port: np.array([received.stamp.time])}
                context.SetAbstractState(state, _Values(values, received.stamp))

    @property
    def channels(self) -> tuple[str, ...]:
        """The names of the channels."""
        return tuple(self._states)

    def is_complete(self, endpoint: "Endpoint") -> bool:
        """Whether something has come on every channel."""
        return all(map(endpoint.newest, self._states))


class _Values(Immutable):
    """The values of a channel's ports, and the Stamp of their message, None before the first."""

    def __init__(self, by_port: dict, stamp: "Stamp | None"):
        self.by_port, self.stamp = by_port, stamp


def _values(context: Context, state: int) -> _Values:
    return context.get_abstract_state(state).get_value()
