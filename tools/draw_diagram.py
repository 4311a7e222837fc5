"""Draws the README's picture of the two diagrams: python -m tools.draw_diagram.

Needs Graphviz (Debian: apt-get install graphviz). For everything that Drake knows of your own
race, ./run.bash --graphviz FILE writes the whole diagram in Graphviz's language.
"""

import argparse
import html
import subprocess
import sys
from pathlib import Path

from pydrake.systems.framework import Diagram

from airrace.common.errors import UserError, exit_code
from airrace.diagrams.autonomy import MakeAutonomy
from airrace.diagrams.simulation import MakeSimulation
from airrace.scenario import load_scenario

# What makes it follow whether the reader's screen is light or dark; Graphviz knows no themes.
STYLE = """<style>
.cluster > polygon { fill: none }
@media (prefers-color-scheme: dark) {
  .graph > polygon { fill: #14181d }
  text { fill: #e6e6e6 }
  polygon[stroke="black"] { stroke: #8b949e }
  polygon[fill="#eef2f7"] { fill: #2a323d }
  .edge { filter: brightness(1.7) }
}
</style>"""
OUTPUT = Path(__file__).resolve().parents[1] / "docs" / "pictures" / "diagram.svg"
COLORS = ("#c0392b", "#2471a3", "#1e8449", "#b9770e", "#7d3c98", "#117a65", "#5d6d7e")


def connections(diagram: Diagram) -> list[tuple[str, str, str, str]]:
    """Returns source, its port, sink, its port of all wires of a diagram, one level deep.

    The diagram's own ports belong to ``inputs`` and ``outputs``.
    """
    wires = [
        (source, source.get_output_port(j).get_name(), sink, sink.get_input_port(i).get_name())
        for (sink, i), (source, j) in diagram.connection_map().items()
    ]
    wires = [(a.get_name(), p, b.get_name(), q) for a, p, b, q in wires]
    for k in range(diagram.num_input_ports()):
        port = diagram.get_input_port(k)
        for system, i in diagram.GetInputPortLocators(port.get_index()):
            name = system.get_input_port(i).get_name()
            wires.append(("inputs", port.get_name(), system.get_name(), name))
    for k in range(diagram.num_output_ports()):
        port = diagram.get_output_port(k)
        system, j = diagram.get_output_port_locator(port.get_index())
        name = system.get_output_port(j).get_name()
        wires.append((system.get_name(), name, "outputs", port.get_name()))
    return wires


def node(diagram: str, name: str, inputs: list, outputs: list) -> str:
    """Returns a node as a table: the name, then the ports in rows, inputs to the left."""

    def cell(side, port):
        if port is None:
            return "<td></td>"
        align = "left" if side == "in" else "right"
        return f'<td port="{side}_{html.escape(port)}" align="{align}">{html.escape(port)}</td>'

    rows = max(len(inputs), len(outputs))
    pairs = zip(inputs + [None] * (rows - len(inputs)), outputs + [None] * (rows - len(outputs)))
    body = "".join(f"<tr>{cell('in', i)}{cell('out', o)}</tr>" for i, o in pairs)
    head = f'<tr><td colspan="2" bgcolor="#eef2f7"><b>{html.escape(name)}</b></td></tr>'
    table = f'<table border="1" cellborder="0" cellspacing="0" cellpadding="2">{head}{body}</table>'
    return f'"{diagram}.{name}" [label=<{table}>];'


def dot(diagrams: list[Diagram]) -> str:
    """Returns diagrams in Graphviz's language, each a cluster."""
    lines = [
        "digraph {",
        'rankdir=LR; nodesep=0.15; ranksep=0.6; bgcolor="white";',
        'node [shape=plain, fontname="sans-serif", fontsize=11]; edge [arrowsize=0.5];',
    ]
    for number, diagram in enumerate(diagrams):
        name, wires = diagram.get_name(), connections(diagram)
        lines.append(f'subgraph cluster_{number} {{ label="{name}"; fontname="sans-serif";')
        for system in dict.fromkeys(x for a, _, b, _ in wires for x in (a, b)):
            inputs = list(dict.fromkeys(q for _, _, b, q in wires if b == system))
            outputs = list(dict.fromkeys(p for a, p, _, _ in wires if a == system))
            lines.append(node(name, system, inputs, outputs))
        lines.append("}")
        sources = list(dict.fromkeys((a, p) for a, p, _, _ in wires))
        for a, p, b, q in wires:
            color = COLORS[sources.index((a, p)) % len(COLORS)]
            ends = f'"{name}.{a}":"out_{p}":e -> "{name}.{b}":"in_{q}":w'
            lines.append(f'{ends} [color="{color}"];')
    return "\n".join([*lines, "}"])


def themed(svg: str) -> str:
    """Returns Graphviz's picture with STYLE in it."""
    head, end, rest = svg.partition("<g id=")
    return f"{head}{STYLE}\n{end}{rest}"


def run(args) -> int:
    """Draws; returns the exit code."""
    scenario = load_scenario()
    text = dot([MakeAutonomy(scenario), MakeSimulation(scenario)])
    if args.output.suffix == ".dot":
        args.output.write_text(text, encoding="utf-8")
        return 0
    try:
        drawn = subprocess.run(
            ["dot", "-Tsvg"], input=text, text=True, check=True, stdout=subprocess.PIPE
        ).stdout
    except FileNotFoundError:
        raise UserError("Graphviz is missing: apt-get install graphviz, or the like.") from None
    args.output.write_text(themed(drawn), encoding="utf-8")
    return 0


def main(argv=None) -> int:
    """The command-line program; returns its exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0] + ".")
    parser.add_argument("--output", type=Path, default=OUTPUT, help="an .svg, or a .dot file")
    args = parser.parse_args(argv)
    return exit_code(lambda: run(args))


if __name__ == "__main__":
    sys.exit(main())
