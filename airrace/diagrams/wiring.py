"""Ports that are joined by their names."""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort, PortDataType, System


class Port(NamedTuple):
    """A port of a system in a diagram, by the names of both."""

    system: str
    name: str


def inputs_of(system: System) -> list[str]:
    """Returns the names of the input ports of a system, or of a diagram."""
    return [system.get_input_port(i).get_name() for i in range(system.num_input_ports())]


def outputs_of(*systems: System) -> dict[str, OutputPort]:
    """Returns the output ports of systems by their names; of two alike, the first system's."""
    ports: dict[str, OutputPort] = {}
    for system in systems:
        for i in range(system.num_output_ports()):
            port = system.get_output_port(i)
            ports.setdefault(port.get_name(), port)
    return ports


def connect_by_name(
    builder: DiagramBuilder,
    sinks: Iterable[System],
    sources: Mapping[str, OutputPort],
    aliases: Mapping[Port, str] = {},
) -> dict[str, list[InputPort]]:
    """Connects every input port of some systems with the output of its name.

    Args:
        builder: of the diagram that all of them are in.
        sinks: the systems.
        sources: what there is, by name, see outputs_of().
        aliases: input ports that get what has another name, to that name.

    Returns:
        the inputs that no source is for, by the names of what they get.
    """
    left: dict[str, list[InputPort]] = {}
    for sink in sinks:
        for i in range(sink.num_input_ports()):
            port = sink.get_input_port(i)
            name = aliases.get(Port(sink.get_name(), port.get_name()), port.get_name())
            if builder.IsConnectedOrExported(port):
                continue
            if name in sources:
                builder.Connect(sources[name], port)
            else:
                left.setdefault(name, []).append(port)
    return left


def export_inputs(builder: DiagramBuilder, inputs: Mapping[str, list[InputPort]]) -> None:
    """Makes inputs of a diagram of what connect_by_name() left; of one name, one input."""
    for name, (first, *others) in inputs.items():
        builder.ExportInput(first, name)
        for port in others:
            builder.ConnectInput(name, port)


def export_outputs(
    builder: DiagramBuilder, sources: Mapping[str, OutputPort], names: Iterable[str]
) -> None:
    """Makes outputs of a diagram of those of the names that there are."""
    for name in names:
        if name in sources:
            builder.ExportOutput(sources[name], name)


def initial_values(source: System, sink: System, names: Iterable[str]) -> dict[str, Any]:
    """Returns what ports hold at first: zeros if they are vectors.

    Args:
        source: a system that has them as outputs, or that has what is made of them.
        sink: a system that has them as inputs.
        names: of the ports.
    """
    return {name: _initial_value(source, sink, name) for name in names}


def _initial_value(source, sink, name):
    if not source.HasOutputPort(name):
        return np.zeros(sink.GetInputPort(name).size())
    port = source.GetOutputPort(name)
    if port.get_data_type() == PortDataType.kVectorValued:
        return np.zeros(port.size())
    return port.Allocate().get_value()
