"""Keeps the map on disk."""

from pathlib import Path

from pydrake.common.value import Value
from pydrake.systems.framework import LeafSystem

from airrace.map_files import write_map
from airrace.systems.types import GateMap


class GateMapWriter(LeafSystem):
    """Writes map.json and map_statistics.json as the map improves.

    .. pydrake_system::

        name: GateMapWriter
        input_ports:
        - gate_map

    ``gate_map`` is a GateMap. A forced publish writes at once.
    """

    def __init__(self, *, directory: Path, period: float = 2.0):
        """Constructs the writer.

        Args:
            directory: where the two files go.
            period: between two writes (s of simulated time).
        """
        LeafSystem.__init__(self)
        self._directory = Path(directory)
        self._map = self.DeclareAbstractInputPort("gate_map", Value[object](GateMap()))
        self.DeclarePeriodicPublishEvent(period, 0.0, self._Write)
        self.DeclareForcedPublishEvent(self._Write)

    def _Write(self, context):
        write_map(self._directory, self._map.Eval(context))
