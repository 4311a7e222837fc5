"""The world of a simulation: the plant with the course in it, and gates that may move."""

from typing import TYPE_CHECKING, NamedTuple

from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant

from airrace.common.errors import UserError
from airrace.rendering.scene.scenery import AddScenery
from airrace.scenario import Scenario
from airrace.systems.plant.gate_mover import GateMover
from airrace.track import Course, load_track

if TYPE_CHECKING:
    from pydrake.systems.framework import DiagramBuilder, OutputPort


class World(NamedTuple):
    """What all drones share.

    Attributes:
        scenario, track: of the race.
        plant, scene_graph: with the course; drones are added before the plant is finalized.
        shown: whether somebody watches in Meshcat.
    """

    scenario: Scenario
    track: Course
    plant: MultibodyPlant
    scene_graph: SceneGraph
    shown: bool

    @property
    def gates_move(self) -> bool:
        """Whether gates move between laps."""
        return self.scenario.disturbances.gate_shift > 0.0


def AddWorld(builder: "DiagramBuilder", scenario: Scenario, shown: bool = False) -> World:
    """Adds a plant, which is not yet finalized, and the course of a scenario.

    Args: shown: whether somebody watches in Meshcat.

    Raises:
        UserError: if the course cannot be had, or its gates cannot move as they should.
    """
    track = load_track(scenario.track)
    plant, scene_graph = AddMultibodyPlant(scenario.plant_config, builder)
    world = World(scenario, track, plant, scene_graph, shown)
    if world.gates_move and not track.closed:
        raise UserError(
            f"The gates of {track.name} are passed only once, and do not move between laps: set "
            "disturbances.gate_shift to 0."
        )
    visible = shown or scenario.camera.renderer == "vtk"
    AddScenery(plant, track, movable=world.gates_move, visible=visible)
    return world


def AddGateMover(builder: "DiagramBuilder", world: World, state: "OutputPort") -> None:
    """Adds what moves gates between laps, and shows it to every system that has a port for it.

    Args: state: of the drone that flies the laps (13).
    """
    scenario = world.scenario
    mover = GateMover(
        track=world.track, max_shift=scenario.disturbances.gate_shift, seed=scenario.seed
    )
    builder.AddNamedSystem("gate_mover", mover)
    builder.Connect(state, mover.GetInputPort("state"))
    shifts = mover.GetOutputPort("gate_shifts")
    for system in builder.GetSystems():
        if system.HasInputPort("gate_shifts"):
            builder.Connect(shifts, system.GetInputPort("gate_shifts"))
    builder.ExportOutput(shifts, "truth.gate_shifts")
