import xml.etree.ElementTree as ET

import pytest
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Adder, Gain, Integrator

from airrace.diagrams.autonomy import OUTPUTS, SYSTEMS, MakeAutonomy
from airrace.diagrams.diagram_layout import boxes_and_wires, layers
from airrace.diagrams.diagram_svg import diagram_svg
from airrace.diagrams.draw import main
from airrace.scenario import Scenario

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture
def loop():
    """An integrator that is fed back: in + -1 x -> x, and a wire around the gain."""
    builder = DiagramBuilder()
    adder = builder.AddNamedSystem("adder", Adder(2, 1))
    integrator = builder.AddNamedSystem("integrator", Integrator(1))
    gain = builder.AddNamedSystem("gain", Gain(-1.0, 1))
    builder.Connect(adder.get_output_port(), integrator.get_input_port())
    builder.Connect(integrator.get_output_port(), gain.get_input_port())
    builder.Connect(gain.get_output_port(), adder.get_input_port(1))
    builder.ExportInput(adder.get_input_port(0), "in")
    builder.ExportOutput(integrator.get_output_port(), "x")
    return builder.Build()


def test_all_boxes_and_wires_are_found(loop):
    systems, wires = boxes_and_wires(loop)
    assert set(systems) == {"inputs", "adder", "integrator", "gain", "outputs"}
    assert {(w.source, w.sink) for w in wires} == {
        ("inputs", "adder"),
        ("adder", "integrator"),
        ("integrator", "gain"),
        ("gain", "adder"),
        ("integrator", "outputs"),
    }


def test_layers_go_from_inputs_to_outputs_even_with_a_loop(loop):
    systems, wires = boxes_and_wires(loop)
    rows = layers(systems, wires)
    order = ["inputs", "adder", "integrator", "gain", "outputs"]
    assert [systems[name].layer for name in order] == [0, 1, 2, 3, 4]
    # The wire to the output passes beside the gain.
    (passage,) = [name for name in rows[3] if name != "gain"]
    assert systems[passage].is_passage


def test_the_picture_of_the_autonomy_has_all_its_boxes_and_ports():
    picture = ET.fromstring(diagram_svg([MakeAutonomy(Scenario())]))
    words = {text.text for text in picture.iter(f"{SVG}text")}
    assert words >= {"autonomy", *SYSTEMS, *OUTPUTS}
    _, wires = boxes_and_wires(MakeAutonomy(Scenario()))
    assert len(list(picture.iter(f"{SVG}path"))) == len(wires)


def test_boxes_do_not_overlap():
    picture = ET.fromstring(diagram_svg([MakeAutonomy(Scenario())]))
    systems = [
        tuple(float(rect.get(k)) for k in ("x", "y", "width", "height"))
        for rect in picture.iter(f"{SVG}rect")
        if rect.get("class")
    ]
    assert len(systems) == len(SYSTEMS) + 2
    for i, (x0, y0, w0, h0) in enumerate(systems):
        for x1, y1, w1, h1 in systems[:i]:
            assert x0 + w0 < x1 or x1 + w1 < x0 or y0 + h0 < y1 or y1 + h1 < y0


def test_the_command_line(tmp_path, capsys):
    path = tmp_path / "race.svg"
    assert main(["--output", str(path)]) == 0
    words = {text.text for text in ET.parse(path).iter(f"{SVG}text")}
    assert {"simulation", "autonomy", "plant", "explorer"} <= words
    assert main(["--output", str(tmp_path / "nowhere" / "race.svg")]) == 2
    assert "there is no folder" in capsys.readouterr().err
