"""Keeps the map on disk."""

from pathlib import Path

from pydrake.common.value import Value

from airrace.systems.leaf_system import LeafSystem
from airrace.track.gate_map import GateMap
from airrace.track.map_files import write_map


class GateMapWriter(LeafSystem):
    """Writes map.json and map_statistics.json as the map improves.

    .. pydrake_system::

        name: GateMapWriter
        input_ports:
        - gate_map

    ``gate_map`` is a GateMap; one that has not changed is not written again. A forced
    publish writes at once.
    """

    def __init__(self, *, directory: Path, period: float):
        """Constructs the writer.

        Args: directory: where the two files go. period: between two writes (s of simulated time).
        """
        LeafSystem.__init__(self)
        self._directory = Path(directory)
        self._map = self.DeclareAbstractInputPort("gate_map", Value[object](GateMap()))
        self._written = None  # what is in the files, wherever the race stands
        self.DeclarePeriodicPublishEvent(period, 0.0, self._write_if_new)
        self.DeclareForcedPublishEvent(self._write)

    def _write_if_new(self, context):
        if self._map.Eval(context) is not self._written:
            self._write(context)

    def _write(self, context):
        gate_map = self._map.Eval(context)
        write_map(self._directory, gate_map)
        self._written = gate_map
