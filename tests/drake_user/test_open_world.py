"""Bodies, sensors, forces and views of the user's own, in the world of a race."""

from pathlib import Path

import numpy as np
import pytest
from drake import lcmt_image_array
from pydrake.common.value import Value
from pydrake.geometry import DrakeVisualizer, Meshcat, MeshcatParams
from pydrake.lcm import DrakeLcm
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import (
    ConnectContactResultsToDrakeVisualizer,  # noqa: F401
    ExternallyAppliedSpatialForce,
)
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.lcm import LcmPublisherSystem
from pydrake.systems.primitives import ConstantValueSource
from pydrake.systems.sensors import ImageToLcmImageArrayT, PixelType
from pydrake.visualization import ApplyVisualizationConfig, ModelVisualizer, VisualizationConfig

from airrace.common.errors import UserError
from airrace.common.resources import models_path
from airrace.diagrams.simulation import MakeSimulation
from airrace.diagrams.world import Addition
from airrace.scenario import Scenario, load_scenario
from airrace.scenario.camera_config import CameraConfig
from airrace.scenario.visualization_config import VisualizationConfig as ScenarioVisualization
from tests.drake_user.flights import HEXAGON, OwnRace, on_a_map, tower_directives

MEMORY = "memq://"


def test_directives_put_a_tower_in_the_way(tmp_path):
    """Which ends the race by its name."""
    scenario = on_a_map(f"{{{tower_directives(tmp_path, 0.0, 0.0)}}}")
    free = OwnRace(on_a_map())
    free.simulator.AdvanceTo(4.0)
    x, y = free.value("truth.state")[4:6]
    scenario = on_a_map(f"{{{tower_directives(tmp_path, x, y)}}}")
    race = OwnRace(scenario)
    race.simulator.AdvanceTo(4.5)
    assert race.value("truth.referee_status").dnf_reason == "touched tower"


@pytest.mark.parametrize(
    "text, words",
    [
        (
            "{directives: [{add_weld: {parent: world, child: nobody}}]}",
            "directives cannot be used:",
        ),
        (
            "{visualization: {lcm_bus: other, enable_meshcat_creation: false}}",
            "visualization cannot be used:",
        ),
    ],
)
def test_what_drake_cannot_use(text, words):
    with pytest.raises(UserError, match=words):
        MakeSimulation(load_scenario(scenario_text=text))


def listening():
    """Returns the addresses at which somebody listens, as Linux tells them."""
    rows = [
        line.split()
        for table in ("/proc/net/tcp", "/proc/net/tcp6")
        for line in Path(table).read_text().splitlines()[1:]
    ]
    return {row[1] for row in rows if row[3] == "0A"}


def test_drakes_own_meshcat_is_on_this_computer_only(monkeypatch):
    monkeypatch.setenv("LCM_DEFAULT_URL", "memq://")
    before = listening()
    simulation = MakeSimulation(load_scenario(scenario_text="{visualization: {}}"))
    assert simulation.HasSubsystemNamed("meshcat_visualizer(illustration)")
    new = listening() - before
    assert new and all(address.endswith("7F", 0, 8) for address in new)  # 127.x.y.z


def test_the_visualization_is_drakes():
    """Its fields and their defaults."""
    ours = vars(ScenarioVisualization())
    assert ours == {name: getattr(VisualizationConfig(), name) for name in ours}


def test_such_scenarios_are_checked():
    """What Drake's own types hold is Drake's business, but for what is no number."""
    frame = "{add_frame: {name: f, X_PF: {base_frame: world, translation: [0, -1, %s]}}}"
    load_scenario(scenario_text="{visualization: {}}").check()
    load_scenario(scenario_text=f"{{directives: [{frame % 0}]}}").check()
    with pytest.raises(UserError, match=r"translation\[2\] must be a finite number"):
        load_scenario(scenario_text=f"{{directives: [{frame % '.nan'}]}}").check()


class Push(Addition):
    """A constant force on the drone, and its height above the ground as an output."""

    def AddToPlant(self, world):
        self.plant_was_open = not world.plant.is_finalized()

    def AddToBuilder(self, builder, world, drone):
        force = ExternallyAppliedSpatialForce()
        force.body_index, force.p_BoBq_B = drone.body.index(), np.zeros(3)
        force.F_Bq_W = SpatialForce(np.zeros(3), np.array([0.0, 0.0, 3.0 * drone.vehicle.mass]))
        source = builder.AddSystem(ConstantValueSource(Value([force])))
        builder.ExportOutput(world.plant.get_body_poses_output_port(), "my.body_poses")
        return [source.get_output_port()]


def test_a_force_and_a_port_of_ones_own():
    """The drone, its rotors at rest, stands lighter on its pad, and falls up if it is strong."""
    push = Push()
    race = OwnRace(on_a_map(), additions=[push])
    assert push.plant_was_open
    free = OwnRace(on_a_map())
    for each in (race, free):
        each.simulator.AdvanceTo(2.5)
    assert race.value("truth.state")[6] > free.value("truth.state")[6] + 0.02
    assert isinstance(race.value("my.body_poses")[0], RigidTransform)


class View(Addition):
    """Drake's own visualization, over LCM."""

    def __init__(self):
        self.lcm = DrakeLcm(MEMORY)
        self.messages = []
        self.lcm.Subscribe("DRAKE_VIEWER_LOAD_ROBOT", self.messages.append)

    def AddToBuilder(self, builder, world, drone):
        config = VisualizationConfig(enable_meshcat_creation=False)
        ApplyVisualizationConfig(
            config, builder, plant=world.plant, scene_graph=world.scene_graph, lcm=self.lcm
        )
        return []


def test_drakes_own_views():
    """Illustration, proximity and inertia go over LCM; contact results have a port."""
    view = View()
    race = OwnRace(on_a_map(), additions=[view], visible=True)
    race.simulator.AdvanceTo(0.05)
    view.lcm.HandleSubscriptions(10)
    assert view.messages
    assert race.value("truth.contact_results").num_point_pair_contacts() > 0


def test_a_view_from_outside():
    """By the exported query port, in one's own builder."""
    builder, lcm, messages = DiagramBuilder(), DrakeLcm(MEMORY), []
    lcm.Subscribe("DRAKE_VIEWER_LOAD_ROBOT", messages.append)
    simulation = builder.AddSystem(MakeSimulation(on_a_map(), visible=True))
    DrakeVisualizer.AddToBuilder(builder, simulation.GetOutputPort("truth.geometry_query"), lcm)
    diagram = builder.Build()
    diagram.ForcedPublish(diagram.CreateDefaultContext())
    lcm.HandleSubscriptions(10)
    assert messages


def test_pictures_go_over_lcm():
    """By Drake's converter and publisher."""
    builder, lcm, messages = DiagramBuilder(), DrakeLcm(MEMORY), []
    lcm.Subscribe("PICTURES", messages.append)
    camera = CameraConfig(width=64, height=48)
    simulation = builder.AddSystem(MakeSimulation(Scenario(track=HEXAGON, camera=camera)))
    convert = builder.AddSystem(ImageToLcmImageArrayT())
    port = convert.DeclareImageInputPort[PixelType.kRgba8U]("camera")
    builder.Connect(simulation.GetOutputPort("camera_image"), port)
    publisher = LcmPublisherSystem.Make(
        "PICTURES", lcmt_image_array, lcm, 0.1, use_cpp_serializer=True
    )
    builder.AddSystem(publisher)
    builder.Connect(convert.image_array_t_msg_output_port(), publisher.get_input_port())
    diagram = builder.Build()
    diagram.ForcedPublish(diagram.CreateDefaultContext())
    lcm.HandleSubscriptions(10)
    assert len(messages) == 1


def test_the_models_are_shown_by_drake():
    """ModelVisualizer takes each drone by the package's name."""
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    for path in sorted(models_path().glob("*/vehicle.yaml")):
        sdf = next(path.parent.glob("*.sdf"))
        visualizer = ModelVisualizer(meshcat=meshcat, publish_contacts=False)
        visualizer.package_map().AddPackageXml(str(models_path() / "package.xml"))
        visualizer.AddModels(url=f"package://airrace/{sdf.relative_to(models_path())}")
        visualizer.Finalize()
        visualizer.Run(loop_once=True)
