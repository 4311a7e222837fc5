"""Ports whose values come from the other half of the autonomy."""

from typing import TYPE_CHECKING, Any

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context

from airrace.common.immutable import Immutable
from airrace.systems.leaf_system import LeafSystem

if TYPE_CHECKING:
    from airrace.hitl.handover import PortValues


class ReceivedPorts(LeafSystem):
    """Holds what was last handed over.

    .. pydrake_system::

        name: ReceivedPorts
        output_ports:
        - the ports that are handed over
        - values_time

    It stands for the other half of the autonomy, as an LcmReceiver stands for the other side of
    the link: its output ports have the names and types of that one's, and show the state, which
    show() sets between two steps of the Simulator. ``values_time``, a vector of one number, is
    the simulated time of the values (s).
    """

    def __init__(self, models: "dict[str, Any]"):
        """Args: models: name of a port to its value before the first, see initial_values()."""
        LeafSystem.__init__(self)
        every = {**models, "values_time": np.zeros(1)}
        self._state = self.DeclareAbstractState(Value[object](_Values(every)))
        ticket = {self.abstract_state_ticket(self._state)}

        def calc(port):
            return lambda context, output: output.set_value(self._values(context).by_port[port])

        for port, model in every.items():
            if isinstance(model, np.ndarray):
                self.DeclareVectorOutputPort(port, len(model), calc(port), ticket)
            else:
                self.DeclareAbstractOutputPort(
                    port, lambda model=model: Value[object](model), calc(port), ticket
                )

    def _values(self, context: Context) -> "_Values":
        return context.get_abstract_state(int(self._state)).get_value()

    def show(self, root_context: Context, message: "PortValues") -> None:
        """Shows the values of a message.

        Args: root_context: of the diagram that is simulated. message: that has come.
        """
        context = self.GetMyMutableContextFromRoot(root_context)
        values = {
            **self._values(context).by_port,
            **message.by_port,
            "values_time": np.array([message.time]),
        }
        context.SetAbstractState(int(self._state), _Values(values))


class _Values(Immutable):
    """The values of the ports."""

    def __init__(self, by_port: dict):
        self.by_port = by_port
