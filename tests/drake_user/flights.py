"""Races in a diagram of the user's own, with pydrake's Simulator."""

from pathlib import Path

from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from airrace.diagrams.autonomy import MakeAutonomy
from airrace.diagrams.simulation import MakeSimulation
from airrace.diagrams.wiring import connect_by_name, outputs_of
from airrace.scenario import Scenario, load_scenario
from airrace.scenario.camera_config import CameraConfig

HEXAGON = "hexagon"
BLIND = CameraConfig(renderer="none")


def on_a_map(text: str = "{}", **fields) -> Scenario:
    """A short race on a map, without a camera; text: YAML of other fields."""
    scenario = load_scenario(scenario_text=text)
    scenario.track, scenario.laps, scenario.map, scenario.camera = HEXAGON, 1, "track", BLIND
    for name, value in fields.items():
        setattr(scenario, name, value)
    return scenario


class OwnRace:
    """Simulation and autonomy in a builder of one's own.

    Attributes: diagram, simulation, simulator.
    """

    def __init__(self, scenario: Scenario, **options):
        """Args: options: of MakeSimulation()."""
        builder = DiagramBuilder()
        self.simulation = builder.AddSystem(MakeSimulation(scenario, **options))
        autonomy = builder.AddSystem(MakeAutonomy(scenario))
        parts = (self.simulation, autonomy)
        connect_by_name(builder, parts, outputs_of(*parts))
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)

    def value(self, port, context=None):
        """The value of an output port of the simulation."""
        context = context or self.simulator.get_context()
        return self.simulation.GetOutputPort(port).Eval(
            self.simulation.GetMyContextFromRoot(context)
        )

    def subsystem(self, name, context=None):
        """A subsystem of the simulation, and its context."""
        system = self.simulation.GetSubsystemByName(name)
        context = context or self.simulator.get_mutable_context()
        return system, system.GetMyMutableContextFromRoot(context)


TOWER = """<sdf version="1.9"><model name="tower"><link name="tower">
<collision name="tower"><geometry><box><size>2 2 8</size></box></geometry></collision>
<visual name="tower"><geometry><box><size>2 2 8</size></box></geometry></visual>
</link></model></sdf>"""


def tower_directives(folder: Path, x: float, y: float) -> str:
    """YAML of a scenario that puts a tower somewhere; the SDF file is written into a folder."""
    (folder / "tower.sdf").write_text(TOWER)
    return (
        f"directives: [{{add_model: {{name: tower, file: 'file://{folder}/tower.sdf'}}}}, "
        f"{{add_frame: {{name: place, X_PF: {{base_frame: world, translation: [{x}, {y}, 4.0]}}}}}}, "
        "{add_weld: {parent: place, child: 'tower::tower'}}]"
    )
