"""Ports that are joined by their names."""

import numpy as np
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from airrace.diagrams.wiring import (
    Port,
    connect_by_name,
    export_inputs,
    export_outputs,
    initial_values,
    outputs_of,
)


class Box(LeafSystem):
    """Has vector ports of the names that are asked for; outputs are their system's number."""

    def __init__(self, inputs=(), outputs=(), number=0.0):
        LeafSystem.__init__(self)
        for name in inputs:
            self.DeclareVectorInputPort(name, 1)
        for name in outputs:
            self.DeclareVectorOutputPort(
                name,
                1,
                lambda context, output: output.SetAtIndex(0, number),
                {self.nothing_ticket()},
            )


def add(builder, name, *args, **kwargs):
    return builder.AddNamedSystem(name, Box(*args, **kwargs))


def seen(diagram, name, port):
    context = diagram.CreateDefaultContext()
    system = diagram.GetSubsystemByName(name)
    return system.GetInputPort(port).Eval(system.GetMyContextFromRoot(context))[0]


def test_of_two_sources_the_first_counts():
    builder = DiagramBuilder()
    sink = add(builder, "sink", ["x"])
    sources = [add(builder, f"source_{i}", outputs=["x"], number=float(i)) for i in (1, 2)]
    assert connect_by_name(builder, [sink], outputs_of(*sources)) == {}
    assert seen(builder.Build(), "sink", "x") == 1.0


def test_an_input_may_get_what_has_another_name():
    builder = DiagramBuilder()
    sinks = [add(builder, name, ["x"]) for name in ("usual", "special")]
    source = add(builder, "source", outputs=["x", "y"], number=1.0)
    other = add(builder, "other", outputs=["z"], number=3.0)
    connect_by_name(builder, sinks, outputs_of(source, other), {Port("special", "x"): "z"})
    diagram = builder.Build()
    assert seen(diagram, "usual", "x") == 1.0 and seen(diagram, "special", "x") == 3.0


def test_what_nobody_has_is_left_and_becomes_one_input_of_the_diagram():
    builder = DiagramBuilder()
    sinks = [add(builder, name, ["x", "wind"], ["y"]) for name in ("one", "two")]
    left = connect_by_name(builder, sinks, outputs_of(add(builder, "source", outputs=["x"])))
    assert {name: len(ports) for name, ports in left.items()} == {"wind": 2}
    export_inputs(builder, left)
    export_outputs(builder, outputs_of(*sinks), ["y", "no_such_port"])
    diagram = builder.Build()
    assert diagram.num_input_ports() == 1 and diagram.num_output_ports() == 1
    context = diagram.CreateDefaultContext()
    diagram.GetInputPort("wind").FixValue(context, [4.0])
    for sink in sinks:
        assert sink.GetInputPort("wind").Eval(sink.GetMyContextFromRoot(context)) == [4.0]


def test_what_is_connected_already_stays_so():
    builder = DiagramBuilder()
    sink = add(builder, "sink", ["x"])
    builder.Connect(
        add(builder, "first", outputs=["x"], number=1.0).get_output_port(), sink.get_input_port()
    )
    connect_by_name(builder, [sink], outputs_of(add(builder, "second", outputs=["x"], number=2.0)))
    assert seen(builder.Build(), "sink", "x") == 1.0


def test_before_the_first_value_a_vector_is_zero():
    values = initial_values(Box(outputs=["x"], number=5.0), Box(["x", "y"]), ["x", "y"])
    assert {name: value.tolist() for name, value in values.items()} == {"x": [0.0], "y": [0.0]}
    assert all(isinstance(value, np.ndarray) for value in values.values())
