import shutil
import xml.etree.ElementTree as ET

import pytest
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Adder, Gain, Integrator

from airrace.diagrams.autonomy import MakeAutonomy
from airrace.diagrams.variants import variant_of
from airrace.diagrams.wiring import outputs_of
from airrace.scenario import Scenario
from tools.draw_diagram import OUTPUT, STYLE, connections, dot, main, themed


def test_all_connections_of_a_loop_are_found():
    """An integrator that is fed back: in - x -> x."""
    builder = DiagramBuilder()
    adder = builder.AddNamedSystem("adder", Adder(2, 1))
    integrator = builder.AddNamedSystem("integrator", Integrator(1))
    gain = builder.AddNamedSystem("gain", Gain(-1.0, 1))
    builder.Connect(adder.get_output_port(), integrator.get_input_port())
    builder.Connect(integrator.get_output_port(), gain.get_input_port())
    builder.Connect(gain.get_output_port(), adder.get_input_port(1))
    builder.ExportInput(adder.get_input_port(0), "in")
    builder.ExportOutput(integrator.get_output_port(), "x")
    assert {(a, b) for a, _, b, _ in connections(builder.Build())} == {
        ("inputs", "adder"),
        ("adder", "integrator"),
        ("integrator", "gain"),
        ("gain", "adder"),
        ("integrator", "outputs"),
    }


def test_the_autonomy_is_drawn_with_all_its_systems_and_ports():
    autonomy = MakeAutonomy(Scenario())
    text = dot([autonomy])
    assert all(f"<b>{name}</b>" in text for name in variant_of(Scenario()).systems)
    assert all(f'"out_{name}"' in text for name in outputs_of(autonomy))


def test_the_picture_in_the_documents_is_of_these_diagrams_and_follows_the_theme():
    svg = OUTPUT.read_text(encoding="utf-8")
    root = ET.fromstring(svg)
    words = {text.text for text in root.findall(".//{*}text")}
    assert {"simulation", "autonomy", *variant_of(Scenario()).systems} <= words
    assert STYLE in svg and themed("<svg><g id=a/></svg>") == f"<svg>{STYLE}\n<g id=a/></svg>"


def test_graphviz_draws_it(tmp_path, capsys):
    if shutil.which("dot") is None:
        assert main(["--output", str(tmp_path / "a.svg")]) == 2
        assert "apt-get install graphviz" in capsys.readouterr().err
        pytest.skip("Graphviz is not installed")
    assert main(["--output", str(tmp_path / "a.svg")]) == 0
    words = {text.text for text in ET.parse(tmp_path / "a.svg").findall(".//{*}text")}
    assert {"simulation", "autonomy", *variant_of(Scenario()).systems} <= words
