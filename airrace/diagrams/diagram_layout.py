"""Where the boxes of a diagram go: in layers, from inputs to outputs.

After Sugiyama, Tagawa and Toda, "Methods for visual understanding of hierarchical
system structures", 1981: break cycles, layer by longest path, order each layer by the
mean place of its neighbours.
"""

import dataclasses as dc

from pydrake.systems.framework import Diagram

INPUTS, OUTPUTS = "inputs", "outputs"  # stand for the diagram's own ports
_SWEEPS = 8


@dc.dataclass
class Box:
    """A subsystem, or the diagram's own ports.

    Attributes:
        name: of the subsystem, INPUTS or OUTPUTS.
        inputs, outputs: names of the ports that are connected, in order.
        layer: from the left, 0, 1, ...
    """

    name: str
    inputs: list = dc.field(default_factory=list)
    outputs: list = dc.field(default_factory=list)
    layer: int = 0

    @property
    def is_passage(self) -> bool:
        """Whether it only keeps a way free for a wire between the boxes of a layer."""
        return not (self.inputs or self.outputs)


@dc.dataclass(frozen=True)
class Wire:
    """A connection: names of two boxes, and of a port of each."""

    source: str
    output: str
    sink: str
    input: str


def boxes_and_wires(diagram: Diagram) -> tuple[dict, list]:
    """Returns the boxes by name and the wires of a diagram, one level deep."""
    boxes = {INPUTS: Box(INPUTS)}
    boxes |= {system.get_name(): Box(system.get_name()) for system in diagram.GetSystems()}
    boxes[OUTPUTS] = Box(OUTPUTS)
    wires = [
        Wire(
            source.get_name(),
            source.get_output_port(j).get_name(),
            sink.get_name(),
            sink.get_input_port(i).get_name(),
        )
        for (sink, i), (source, j) in diagram.connection_map().items()
    ]
    for k in range(diagram.num_input_ports()):
        port = diagram.get_input_port(k)
        for system, i in diagram.GetInputPortLocators(port.get_index()):
            wires.append(
                Wire(
                    INPUTS, port.get_name(), system.get_name(), system.get_input_port(i).get_name()
                )
            )
    for k in range(diagram.num_output_ports()):
        port = diagram.get_output_port(k)
        system, j = diagram.get_output_port_locator(port.get_index())
        wires.append(
            Wire(system.get_name(), system.get_output_port(j).get_name(), OUTPUTS, port.get_name())
        )
    for wire in wires:
        _add(boxes[wire.source].outputs, wire.output)
        _add(boxes[wire.sink].inputs, wire.input)
    return {name: box for name, box in boxes.items() if box.inputs or box.outputs}, wires


def _add(names, name):
    if name not in names:
        names.append(name)


def passage(wire: Wire, layer: int) -> str:
    """Returns the name of the box through which a wire crosses a layer."""
    return f"{wire.source}.{wire.output} through {layer}"


def layers(boxes: dict, wires) -> list:
    """Sets the layer of every box, and adds passages for wires that cross layers.

    Returns:
        lists of names, a list a layer, each ordered from the top.
    """
    after = {name: [] for name in boxes}
    for wire in wires:
        if wire.source != wire.sink:
            _add(after[wire.source], wire.sink)
    order = _without_cycles(after)
    for name in order:
        for sink in after[name]:
            if order.index(sink) > order.index(name):
                boxes[sink].layer = max(boxes[sink].layer, boxes[name].layer + 1)
    if OUTPUTS in boxes:
        boxes[OUTPUTS].layer = 1 + max(
            (box.layer for name, box in boxes.items() if name != OUTPUTS), default=0
        )
    links = set()
    for wire in wires:
        here = wire.source
        for layer in range(boxes[wire.source].layer + 1, boxes[wire.sink].layer):
            name = passage(wire, layer)
            boxes.setdefault(name, Box(name, layer=layer))
            links.add((here, name))
            here = name
        links.add((here, wire.sink))
    rows = [[] for _ in range(1 + max(box.layer for box in boxes.values()))]
    for name, box in boxes.items():
        rows[box.layer].append(name)
    return _ordered(rows, sorted(links))


def _without_cycles(after) -> list:
    """Returns names so that most wires lead forward: a depth-first search, reversed."""
    order, seen = [], set()

    def visit(name):
        seen.add(name)
        for sink in after[name]:
            if sink not in seen:
                visit(sink)
        order.append(name)

    for name in after:
        if name not in seen:
            visit(name)
    return order[::-1]


def _ordered(rows, links) -> list:
    neighbours = {}
    for a, b in links:
        neighbours.setdefault(a, []).append(b)
        neighbours.setdefault(b, []).append(a)
    for _ in range(_SWEEPS):
        place = {name: (k + 0.5) / len(row) for row in rows for k, name in enumerate(row)}
        for row in rows:
            row.sort(key=lambda name: _mean([place[n] for n in neighbours.get(name, [name])]))
    return rows


def _mean(numbers):
    return sum(numbers) / len(numbers)
