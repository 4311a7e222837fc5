"""The world of a simulation: the plant with the course in it, and gates that may move."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from pydrake.geometry import SceneGraph
from pydrake.multibody.parsing import ModelDirectives, Parser, ProcessModelDirectives
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant

from airrace.common.errors import UserError
from airrace.common.resources import models_path
from airrace.rendering.scene.scenery import AddScenery
from airrace.scenario import Scenario
from airrace.systems.plant.gate_mover import GateMover
from airrace.systems.seed import AddSeedSource
from airrace.track import Course, load_track

if TYPE_CHECKING:
    from pydrake.systems.framework import DiagramBuilder, OutputPort

    from airrace.diagrams.drone import Drone


class World(NamedTuple):
    """What all drones share."""

    #: scenario, track: of the race
    scenario: Scenario
    track: Course
    #: plant, scene_graph: with the course; drones are added before the plant is finalized
    plant: MultibodyPlant
    scene_graph: SceneGraph
    seed: "OutputPort"  #: the port of what is random; see SeedSource
    shown: bool  #: whether the drone and the course are drawn, in Meshcat or by your own means

    @property
    def gates_move(self) -> bool:
        """Whether gates move between laps."""
        return self.scenario.disturbances.gate_shift > 0.0


class Addition:
    """What you add to the simulated world: bodies, sensors, forces, views. See docs/drake.md.

    Both methods do nothing; override what you need, and give it to MakeSimulation().
    """

    def AddToPlant(self, world: World) -> None:
        """Adds bodies or geometry to ``world.plant``, before it is finalized."""

    def AddToBuilder(
        self, builder: "DiagramBuilder", world: World, drone: "Drone"
    ) -> "Sequence[OutputPort] | None":
        """Adds systems to the diagram, which may export ports of their own.

        Args:
            builder: of the Simulation; ``plant`` and ``scene_graph`` are in it.
            world: whose plant is finalized.
            drone: that flies.

        Returns:
            ports of forces on bodies, lists of ExternallyAppliedSpatialForce; or None.
        """


def AddWorld(builder: "DiagramBuilder", scenario: Scenario, shown: bool = False) -> World:
    """Adds a plant, which is not yet finalized, the course of a scenario, and its directives.

    Args: shown: see World.

    Raises:
        UserError: if the course cannot be had, its gates cannot move as they should, or Drake
            cannot take the directives.
    """
    track = load_track(scenario.track)
    plant, scene_graph = AddMultibodyPlant(scenario.plant_config, builder)
    seed = AddSeedSource(builder, scenario.seed)
    world = World(scenario, track, plant, scene_graph, seed, shown)
    if world.gates_move and not track.closed:
        raise UserError(
            f"The gates of {track.name} are passed only once, and do not move between laps: set "
            "disturbances.gate_shift to 0."
        )
    visible = shown or scenario.camera.renderer == "vtk"
    AddScenery(plant, track, movable=world.gates_move, visible=visible)
    if scenario.directives:
        _add_directives(plant, scenario)
    return world


def _add_directives(plant: MultibodyPlant, scenario: Scenario) -> None:
    parser = Parser(plant)
    parser.package_map().AddPackageXml(str(models_path() / "package.xml"))
    try:
        ProcessModelDirectives(ModelDirectives(directives=scenario.directives), parser)
    except (RuntimeError, MemoryError, SystemExit) as e:  # the last is Drake's for what must not be
        raise UserError(f"directives cannot be used: {' '.join(str(e).split())}") from None


def AddGateMover(builder: "DiagramBuilder", world: World, state: "OutputPort") -> None:
    """Adds what moves gates between laps, and shows it to every system that has a port for it.

    Args: state: of the drone that flies the laps (13).
    """
    scenario = world.scenario
    mover = GateMover(track=world.track, max_shift=scenario.disturbances.gate_shift)
    builder.AddNamedSystem("gate_mover", mover)
    builder.Connect(state, mover.GetInputPort("state"))
    builder.Connect(world.seed, mover.GetInputPort("seed"))
    shifts = mover.GetOutputPort("gate_shifts")
    for system in builder.GetSystems():
        if system.HasInputPort("gate_shifts"):
            builder.Connect(shifts, system.GetInputPort("gate_shifts"))
    builder.ExportOutput(shifts, "truth.gate_shifts")
