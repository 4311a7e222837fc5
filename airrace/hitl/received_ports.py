"""Ports whose values come from elsewhere: over LCM, or from the other half of the autonomy."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import AbstractStateIndex, Context

from airrace.common.immutable import Immutable
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.sensing.picture_ports import IMAGE_TYPES

if TYPE_CHECKING:
    from airrace.hitl.channels import PortChannel
    from airrace.hitl.handover import PortValues
    from airrace.hitl.link.endpoint import Endpoint


class _Values(Immutable):
    """The values of ports that change together, and what they came with, None before the first."""

    def __init__(self, by_port: dict, source: object = None):
        self.by_port, self.source = by_port, source


class ReceivedPorts(LeafSystem):
    """Holds what was last handed over.

    .. pydrake_system::

        name: ReceivedPorts
        output_ports:
        - the ports that are handed over
        - values_time

    It stands for the other half of the autonomy: its output ports have the names and types of
    that one's. They show the state, which show() sets between two steps of the Simulator, so that
    all systems see the same values within a step. ``values_time``, a vector of one number, is the
    simulated time of the values (s).
    """

    def __init__(self, models: dict[str, Any]):
        """Args: models: name of a port to its value before the first, see initial_values()."""
        LeafSystem.__init__(self)
        self._state = self._declare({**models, "values_time": np.zeros(1)})

    def _declare(self, models: Mapping[str, Any]) -> int:
        """Declares ports, a vector where a model is an array, and the state that they show."""
        state = int(self.DeclareAbstractState(Value[object](_Values({**models}))))
        ticket = {self.abstract_state_ticket(AbstractStateIndex(state))}

        def calc(port):
            return lambda context, output: output.set_value(
                self._values(context, state).by_port[port]
            )

        for port, model in models.items():
            if isinstance(model, np.ndarray):
                self.DeclareVectorOutputPort(port, len(model), calc(port), ticket)
            else:
                value: AbstractValue = Value[IMAGE_TYPES.get(port, object)]()
                self.DeclareAbstractOutputPort(port, value.Clone, calc(port), ticket)
        return state

    def _values(self, context: Context, state: int) -> _Values:
        return context.get_abstract_state(state).get_value()

    def show(self, root_context: Context, message: "PortValues") -> None:
        """Shows the values of a message.

        Args: root_context: of the diagram that is simulated. message: that has come.
        """
        context = self.GetMyMutableContextFromRoot(root_context)
        before, now = self._values(context, self._state).by_port, np.array([message.time])
        values = _Values({**before, **message.by_port, "values_time": now})
        context.SetAbstractState(self._state, values)


class LcmReceiver(ReceivedPorts):
    """Holds the values of the last message of each channel of the other side.

    .. pydrake_system::

        name: LcmReceiver
        output_ports:
        - the ports of each channel
        - the first of them, with _time added

    It stands for the diagram on the other side of the link, see ReceivedPorts. The last port of
    a channel is the simulated time at which its message was sent (s).
    """

    def __init__(self, channels: "Sequence[PortChannel]", role: str):
        """Args: channels: of the race. role: of this side."""
        LeafSystem.__init__(self)
        self._states = {  # name of a channel to its abstract state and the port of the time
            channel.name: (self._declare({**channel.initial, time: np.zeros(1)}), time)
            for channel in channels
            if channel.sender != role and not channel.ports[0].startswith("truth.")
            for time in [f"{channel.ports[0]}_time"]
        }

    def receive(self, root_context: Context, endpoint: "Endpoint") -> None:
        """Shows the newest values that have come.

        Args: root_context: of the diagram that is simulated. endpoint: that has drained what came.
        """
        context = self.GetMyMutableContextFromRoot(root_context)
        for channel, (state, time_port) in self._states.items():
            received = endpoint.newest(channel, context.get_time())
            if received is not None and received.stamp is not self._values(context, state).source:
                values = {**received.value, time_port: np.array([received.stamp.time])}
                context.SetAbstractState(state, _Values(values, received.stamp))

    @property
    def channels(self) -> tuple[str, ...]:
        """The names of the channels."""
        return tuple(self._states)

    def is_complete(self, endpoint: "Endpoint") -> bool:
        """Whether something has come on every channel."""
        return not self.missing(endpoint)

    def missing(self, endpoint: "Endpoint") -> list[str]:
        """Returns the names of the channels on which nothing has come."""
        return [channel for channel in self._states if endpoint.newest(channel) is None]
