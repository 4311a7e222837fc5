import shutil
import textwrap

import numpy as np
import pytest
from pydrake.systems.framework import InputPortIndex

from airrace.common.errors import UserError
from airrace.diagrams.autonomy import MakeAutonomy
from airrace.diagrams.race import MakeRace, run_race
from airrace.diagrams.variants import variant_of
from airrace.scenario import Scenario
from airrace.systems.estimation.state_filter import UnfilteredState
from airrace.vehicle import find_vehicle
from tests.worlds.looks import Looks

STUDENT = """
    from pydrake.systems.framework import DiagramBuilder, LeafSystem
    from airrace.systems.control.geometric_controller import GeometricController
    from airrace.systems.planning.lap_planner import LapPlanner
    from airrace.systems.planning.trajectory_tracker import TrajectoryTracker
    from airrace.vehicle import load_vehicle

    updates = 0

    class MyController(GeometricController):
        def __init__(self, scenario):
            super().__init__(vehicle=load_vehicle(scenario.drone)[0], rate=250.0)

        def calc_wrench(self, reference, estimate):
            global updates
            updates += 1
            return super().calc_wrench(reference, estimate)

    def as_diagram(scenario):
        "A box may be a diagram of its own."
        builder = DiagramBuilder()
        box = builder.AddSystem(TrajectoryTracker())
        for name in ("lap_plan", "exploration_reference"):
            builder.ExportInput(box.GetInputPort(name), name)
        builder.ExportOutput(box.GetOutputPort("reference"), "reference")
        return builder.Build()

    class Looker(TrajectoryTracker):
        "Uses every input that Autonomy has, and outputs of other systems."
        def __init__(self, scenario):
            super().__init__()
            from pydrake.common.value import Value
            from pydrake.systems.sensors import ImageRgba8U
            self.DeclareAbstractInputPort("camera_image", Value(ImageRgba8U()))
            self.DeclareVectorInputPort("camera_image_time", 1)
            self.DeclareAbstractInputPort("camera_info", Value[object]())
            self.DeclareVectorInputPort("state_estimate", 14)
            self.DeclareVectorInputPort("rotor_speeds", 4)
            self.DeclareVectorInputPort("rotor_losses", 4)
            self.DeclareVectorInputPort("disturbance", 3)
            self.DeclareAbstractInputPort("gate_map", Value[object]())
            self.DeclareVectorOutputPort("debug", 1, lambda context, output: None)

    class Hungry(TrajectoryTracker):
        def __init__(self, scenario):
            super().__init__()
            self.DeclareVectorInputPort("wind", 3)

    class Mute(LeafSystem):
        def __init__(self, scenario):
            super().__init__()

    class WrongSize(LeafSystem):
        def __init__(self, scenario):
            super().__init__()
            self.DeclareVectorOutputPort("reference", 3, lambda context, output: None)

    class WrongSpeeds(LeafSystem):
        def __init__(self, scenario):
            super().__init__()
            self.DeclareVectorOutputPort("rotor_speed_command", 3, lambda context, output: None)

    class Loop(LeafSystem):
        "Takes what it makes."
        def __init__(self, scenario):
            super().__init__()
            self.DeclareVectorInputPort("reference", 18)
            self.DeclareVectorOutputPort("reference", 18, lambda context, output: None)

    def broken(scenario):
        return scenario.no_such_field

    class NoArguments(TrajectoryTracker):
        def __init__(self):
            super().__init__()

    class Forgetful(GeometricController):
        def calc_wrench(self, reference):
            return super().calc_wrench(reference, reference)

    forgetful = Forgetful.from_scenario

    def solve():
        return None

    def planner(scenario):
        return LapPlanner.from_scenario(scenario, solve=solve)

    class Planner(LapPlanner):
        def solve(self):
            return None

    own_planner = Planner.from_scenario

    def no_solver(scenario):
        return LapPlanner.from_scenario(scenario, solve="quickly")

    number = 3
"""


@pytest.fixture(autouse=True)
def student_boxes(tmp_path, monkeypatch):
    (tmp_path / "student_boxes.py").write_text(textwrap.dedent(STUDENT))
    (tmp_path / "typo.py").write_text("def make(scenario)\n    pass\n")
    (tmp_path / "crash.py").write_text("import math\n\nmath.sqrt(-1.0)\n")
    monkeypatch.syspath_prepend(tmp_path)


def port_names(count, get):
    return [get(i).get_name() for i in range(count)]


def test_ports():
    autonomy, variant = MakeAutonomy(Scenario()), variant_of(Scenario())
    inputs = port_names(autonomy.num_input_ports(), autonomy.get_input_port)
    outputs = port_names(autonomy.num_output_ports(), autonomy.get_output_port)
    own = {"camera_image", "camera_grey"}  # for systems of your own
    assert set(inputs) == set(variant.inputs) - own
    assert outputs == [name for name in variant.outputs if name != "negative_thrusts"]
    # A rotor speed must not depend on this very instant's picture.
    command = autonomy.GetOutputPort("rotor_speed_command").get_index()
    assert not any(
        autonomy.HasDirectFeedthrough(i, command) for i in range(autonomy.num_input_ports())
    )


def test_without_the_state_filter_all_get_the_estimate_as_it_is():
    """The controller and the mapper."""
    scenario = Scenario()
    scenario.state_filter.enabled = False
    autonomy = MakeAutonomy(scenario)
    assert type(autonomy.GetSubsystemByName("state_filter")) is UnfilteredState
    context, estimate = autonomy.CreateDefaultContext(), np.arange(14.0)
    autonomy.GetInputPort("state_estimate").FixValue(context, estimate)
    for name in ("geometric_controller", "gate_mapper"):
        box = autonomy.GetSubsystemByName(name)
        port = box.GetInputPort("filtered_estimate")
        np.testing.assert_array_equal(port.Eval(box.GetMyContextFromRoot(context)), estimate)


def test_a_drone_without_the_originals_gains_is_told(tmp_path):
    mine = shutil.copytree(find_vehicle("Default").parent, tmp_path / "mine")
    text = (mine / "vehicle.yaml").read_text()
    (mine / "vehicle.yaml").write_text(text[: text.index("original_gains: {")])
    scenario = Scenario(drone=str(mine))
    MakeAutonomy(scenario)
    scenario.controller.gains = "original"
    with pytest.raises(UserError, match="controller.gains 'original' needs original_gains in the"):
        MakeAutonomy(scenario)


def test_every_input_of_every_box_is_fed():
    autonomy = MakeAutonomy(Scenario())
    fed = {(box.get_name(), int(port)) for box, port in autonomy.connection_map()}
    for i in range(autonomy.num_input_ports()):
        for box, port in autonomy.GetInputPortLocators(InputPortIndex(i)):
            fed.add((box.get_name(), int(port)))
    every = {
        (box.get_name(), i): box.get_input_port(i).get_name()
        for box in autonomy.GetSystems()
        for i in range(box.num_input_ports())
    }
    left = {name for port, name in every.items() if port not in fed}
    assert left == variant_of(Scenario()).optional - {"negative_thrusts"}  # nobody hears them


@pytest.mark.slow
def test_a_students_box_flies(tmp_path):
    import student_boxes

    scenario = Scenario(
        systems={
            "geometric_controller": "student_boxes:MyController",
            "trajectory_tracker": "student_boxes:as_diagram",
        }
    )
    scenario.referee.time_limit = 3.0
    looks = Looks()
    student_boxes.updates = 0
    result = run_race(scenario, tmp_path, sinks=[looks.take])
    assert result["dnf_reason"].startswith("ran out of time")
    assert student_boxes.updates == pytest.approx(250 * 0.1 * len(looks), abs=2)
    assert 4.5 < looks[-1].state[6] < 5.5


def test_a_box_may_look_at_all_that_autonomy_has():
    race = MakeRace(Scenario(systems={"trajectory_tracker": "student_boxes:Looker"}))
    box = race.GetSubsystemByName("autonomy").GetSubsystemByName("trajectory_tracker")
    assert type(box).__name__ == "Looker"
    context = box.GetMyContextFromRoot(race.CreateDefaultContext())
    for i in range(box.num_input_ports()):
        assert box.get_input_port(i).HasValue(context)


BAD = {
    "no such box": (
        {"pilot": "a:b"},
        "systems.pilot is not a system of the autonomy; there are: aruco_detector, ",
    ),
    "no module": (
        {"explorer": "nobody:Box"},
        "systems.explorer: 'nobody:Box' cannot be imported as "
        r"module:callable \(ModuleNotFoundError: No module named 'nobody'\)",
    ),
    "no attribute": ({"explorer": "student_boxes:Box"}, "has no attribute 'Box'"),
    "no colon": ({"explorer": "student_boxes"}, "module:callable"),
    "empty": ({"explorer": ""}, "module:callable"),
    "relative": ({"explorer": ".student_boxes:MyController"}, "module:callable"),
    "syntax error": ({"explorer": "typo:make"}, r"SyntaxError: .*typo.py, line 1"),
    "crash": ({"explorer": "crash:make"}, r"ValueError: .*, at .*/crash.py:3\)"),
    "no callable": ({"explorer": "student_boxes:number"}, "cannot be called .*not callable"),
    "no system": ({"explorer": "builtins:str"}, "builtins:str must return a System, not a str"),
    "broken": (
        {"explorer": "student_boxes:broken"},
        r"AttributeError: .*no_such_field.*, at .*student_boxes.py:\d+\)",
    ),
    "no arguments": (
        {"trajectory_tracker": "student_boxes:NoArguments"},
        "cannot be called with the scenario .*TypeError",
    ),
    "calc_wrench without the estimate": (
        {"geometric_controller": "student_boxes:forgetful"},
        r"student_boxes:forgetful: student_boxes.Forgetful.calc_wrench\(\) is called with \(reference, "
        r"estimate\), but it takes \(reference\): give it these arguments",
    ),
    "solve without a problem": (
        {"lap_planner": "student_boxes:planner"},
        r"systems.lap_planner: student_boxes:planner: student_boxes.solve\(\) is called with "
        r"\(problem\), but it takes \(\)",
    ),
    "a planner's solve without a problem": (
        {"lap_planner": "student_boxes:own_planner"},
        r"student_boxes.Planner.solve\(\) is called with \(problem\), but it takes \(\)",
    ),
    "solve is no function": (
        {"lap_planner": "student_boxes:no_solver"},
        r"gave 'quickly' \(str\); it must give a function of \(problem\)",
    ),
    "unknown input": (
        {"trajectory_tracker": "student_boxes:Hungry"},
        "trajectory_tracker has an input port 'wind', which nothing provides; "
        "there are: camera_image, ",
    ),
    "no output": (
        {"trajectory_tracker": "student_boxes:Mute"},
        "trajectory_tracker must have an output port 'reference'",
    ),
    "wrong size": (
        {"trajectory_tracker": "student_boxes:WrongSize"},
        "do not fit together: .*sizes.* reference",
    ),
    "wrong speeds": (
        {"geometric_controller": "student_boxes:WrongSpeeds"},
        "do not fit: .*rotor_speed_command.*size",
    ),
    "loop": ({"trajectory_tracker": "student_boxes:Loop"}, "do not fit together: .*loop"),
}


@pytest.mark.parametrize("systems, words", BAD.values(), ids=BAD)
def test_a_bad_box_is_named_in_a_sentence(systems, words):
    with pytest.raises(UserError, match=words) as e:
        MakeRace(Scenario(systems=systems))
    assert "\n" not in str(e.value)
