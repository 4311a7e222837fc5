import json

import pytest
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantValueSource

from airrace.common.errors import UserError
from airrace.systems.mapping.gate_map_writer import GateMapWriter
from airrace.track.gate_map import GateMap


class Mapper(LeafSystem):
    """Has seen ten markers a second."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareAbstractOutputPort("gate_map", lambda: Value[object](GateMap()), self._calc)

    def _calc(self, context, output):
        time = context.get_time()
        output.set_value(GateMap(time=time, detections=round(10 * time)))


def start(directory):
    builder = DiagramBuilder()
    mapper = builder.AddSystem(Mapper())
    writer = builder.AddSystem(GateMapWriter(directory=directory, period=1.0))
    builder.Connect(mapper.get_output_port(), writer.GetInputPort("gate_map"))
    return Simulator(builder.Build())


def times(directory):
    """When the two files were written (s)."""
    names = ("map.json", "map_statistics.json")
    return [json.loads((directory / name).read_text())["time_s"] for name in names]


def test_writes_from_the_start_and_once_a_period(tmp_path):
    simulator = start(tmp_path)
    assert not list(tmp_path.iterdir())
    simulator.Initialize()
    assert times(tmp_path) == [0.0, 0.0]
    simulator.AdvanceTo(0.99)
    assert times(tmp_path) == [0.0, 0.0]
    simulator.AdvanceTo(2.5)
    assert times(tmp_path) == [2.0, 2.0]
    assert json.loads((tmp_path / "map_statistics.json").read_text())["detections"] == 20


def test_a_forced_publish_writes_at_once(tmp_path):
    simulator = start(tmp_path)
    simulator.AdvanceTo(2.5)
    simulator.get_system().ForcedPublish(simulator.get_context())
    assert times(tmp_path) == [2.5, 2.5]


def test_a_map_that_does_not_change_is_written_once(tmp_path):
    builder = DiagramBuilder()
    source = builder.AddSystem(ConstantValueSource(Value[object](GateMap(time=3.0))))
    writer = builder.AddSystem(GateMapWriter(directory=tmp_path, period=1.0))
    builder.Connect(source.get_output_port(), writer.GetInputPort("gate_map"))
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(0.5)
    (tmp_path / "map.json").unlink()
    simulator.AdvanceTo(2.5)
    assert not (tmp_path / "map.json").exists()
    simulator.get_system().ForcedPublish(simulator.get_context())
    assert times(tmp_path) == [3.0, 3.0]


def test_a_folder_that_went_away_is_named(tmp_path):
    simulator = start(tmp_path / "gone")
    with pytest.raises(UserError, match="gone/map.json cannot be written"):
        simulator.AdvanceTo(1.5)
