"""Systems of a scenario's own: what their ports give is checked, and what is right flies the same."""

import sys
import textwrap

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.framework import DiagramBuilder

from airrace.common.errors import UserError
from airrace.diagrams.autonomy import MakeAutonomy
from airrace.diagrams.checked_ports import checked_outputs
from airrace.diagrams.wiring import Port
from airrace.scenario import Scenario
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.types import ExplorerStatus

NAN = float("nan")


class Box(LeafSystem):
    """Has one output port with a value of choice."""

    def __init__(self, name, value, size=None):
        LeafSystem.__init__(self)
        if size is None:
            self.DeclareAbstractOutputPort(
                name,
                lambda: Value[object]("nothing yet"),
                lambda context, output: output.set_value(value),
            )
        else:
            self.DeclareVectorOutputPort(
                name, size, lambda context, output: output.set_value(value)
            )


def given(system, port, own=True):
    """Returns what is heard of the port of a system called "mine"."""
    builder = DiagramBuilder()
    builder.AddNamedSystem("mine", system)
    scenario = Scenario(systems={"mine": "a:b"} if own else {})
    ports = checked_outputs(builder, {"mine": system}, scenario)
    builder.ExportOutput(ports[Port("mine", port)], port)
    diagram = builder.Build()
    return diagram.GetOutputPort(port).Eval(diagram.CreateDefaultContext())


@pytest.mark.parametrize(
    ("port", "value", "size", "words"),
    [
        ("rotor_speed_command", [1.0, NAN, 1.0, 1.0], 4, "4 finite numbers"),
        ("rotor_speed_command", [1.0, np.inf, 1.0, 1.0], 4, "4 finite numbers"),
        ("exploration_reference", [NAN] * 18, 18, "18 finite numbers"),
        ("rate_command", [NAN] * 4, 4, "4 finite numbers"),
        ("filtered_estimate", [NAN, *[0.0] * 13], 14, "14 finite numbers"),
        ("detections", "nothing", None, "an instance of airrace.systems.types.Detections"),
        ("gate_map", "a map", None, "an instance of airrace.track.gate_map.GateMap"),
        ("explorer_status", ExplorerStatus(since=NAN), None, "a finite number"),
        ("lap_plan", 3, None, "LapPlan"),
        ("policy_status", (), None, "PolicyStatus"),
        ("estimate_fault", 3, None, "an instance of builtins.str"),
    ],
)
def test_the_class_the_port_what_came_and_what_is_wanted(port, value, size, words):
    with pytest.raises(UserError) as error:
        given(Box(port, value, size), port)
    text = str(error.value)
    assert text.startswith(
        f"systems.mine: tests.diagrams.test_checked_ports.Box, output port {port},"
    )
    assert " gave " in text and text.endswith(f"{words}.") or words in text


def test_what_is_right_goes_through():
    np.testing.assert_array_equal(given(Box("reference", np.arange(18.0), 18), "reference")[17], 17)
    status = ExplorerStatus(done=True)
    assert given(Box("explorer_status", status), "explorer_status") is status
    unknown = given(Box("filtered_estimate", [NAN] * 14, 14), "filtered_estimate")
    assert np.isnan(unknown).all()  # nothing is known yet
    assert np.isinf(given(Box("rotor_losses", [np.inf] * 4, 4), "rotor_losses")).all()
    assert given(Box("debug", "anything"), "debug") == "anything"


def test_systems_of_airrace_have_no_door():
    assert np.isnan(given(Box("reference", [NAN] * 18, 18), "reference", own=False)).all()


def test_the_door_is_in_the_autonomy(tmp_path, monkeypatch):
    text = """
    from airrace.systems.control.geometric_controller import GeometricController

    class Mine(GeometricController):
        pass

    make = Mine.from_scenario
    """
    (tmp_path / "doored_box.py").write_text(textwrap.dedent(text))
    monkeypatch.syspath_prepend(tmp_path)
    autonomy = MakeAutonomy(Scenario(systems={"geometric_controller": "doored_box:make"}))
    assert autonomy.HasSubsystemNamed("checked_geometric_controller")
    assert not autonomy.HasSubsystemNamed("checked_explorer")
    sys.modules.pop("doored_box")
