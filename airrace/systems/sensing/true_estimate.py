"""The truth in the form of a state estimate."""

from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_vector
from airrace.vehicle.state import STATE_SIZE


class TrueEstimate(LeafSystem):
    """Shows the truth as an estimate, to environments and flight controllers, but no autonomy.

    .. pydrake_system::

        name: TrueEstimate
        input_ports:
        - truth.state
        output_ports:
        - filtered_estimate

    ``truth.state`` is the plant's floating-base state (13), ``filtered_estimate`` a
    vehicle.State (14).
    """

    def __init__(self) -> None:
        """Constructs the system."""
        LeafSystem.__init__(self)
        self._state = self.DeclareVectorInputPort("truth.state", STATE_SIZE - 1)
        self.DeclareVectorOutputPort("filtered_estimate", STATE_SIZE, self._calc_estimate)

    def _calc_estimate(self, context, output):
        estimate = output.get_mutable_value()
        estimate[0] = context.get_time()
        estimate[1:] = read_vector(self._state, context)
