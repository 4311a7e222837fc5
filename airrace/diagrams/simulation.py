"""The Simulation diagram: where the truth lives."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from pydrake.geometry import Meshcat, MeshcatVisualizer, MeshcatVisualizerParams
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from airrace.common.errors import UserError
from airrace.diagrams.drone import AddDrone, PlaceDrone
from airrace.diagrams.world import AddGateMover, Addition, AddWorld, World
from airrace.scenario import Scenario
from airrace.systems.plant.drawn_body import DrawnBody
from airrace.systems.plant.gate_mover import GateMover
from airrace.systems.plant.multirotor import ApplyForces


def MakeSimulation(
    scenario: Scenario,
    meshcat: Meshcat | None = None,
    *,
    additions: Sequence[Addition] = (),
    visible: bool = False,
) -> Diagram:
    """Builds the simulated world of a scenario.

    Input ports: ``rotor_speed_command`` (vector, rad/s) and
    ``explorer_status`` (ExplorerStatus), with which the team says that it races.
    Output ports for the autonomy: ``camera_image`` (ImageRgba8U),
    ``camera_grey`` (the same picture, ImageGrey8U), ``camera_view`` (the same once more,
    drawn only where it is read, CameraView),
    ``camera_image_time`` (s), ``camera_info`` (CameraInfo), ``rotor_speeds`` (rad/s) and
    ``rotor_status`` (see RotorBank) of the motor controllers; and ``state_estimate`` (see
    vehicle/state.py), or with the estimator ``vio`` ``imu`` (see ImuSamples) in its place.
    Truth, for judges and spectators only: ``truth.state`` (13),
    ``truth.referee_status`` (RefereeStatus), the plant's ``truth.contact_results`` and the
    SceneGraph's ``truth.geometry_query``; if gates move, ``truth.gate_shifts`` (see GateMover),
    which the plant's bodies follow by MakeMonitor(); and if contacts do not end the race,
    ``truth.contacts`` (see ContactSensor).

    The drone that flies is the scenario's with the errors of its disturbances.

    Args:
        scenario: the race.
        meshcat: a Meshcat to show the world in, or None.
        additions: what else is in the world.
        visible: whether there is geometry to look at, though no meshcat is given: for
            visualizers and cameras of your own.

    Raises:
        UserError: if the track, the drone or the renderer cannot be had, or a
            rotor fails that is not there.
    """
    shown = visible or meshcat is not None or scenario.visualization is not None
    builder = DiagramBuilder()
    world = AddWorld(builder, scenario, shown=shown)
    drone = PlaceDrone(world, world.track.start)
    for addition in additions:
        addition.AddToPlant(world)
    world.plant.Finalize()
    forces = AddDrone(builder, world, drone)
    for addition in additions:
        forces += addition.AddToBuilder(builder, world, drone) or ()
    ApplyForces(builder, world.plant, forces)
    contacts = world.plant.get_contact_results_output_port()
    builder.ExportOutput(contacts, "truth.contact_results")
    builder.ExportOutput(world.scene_graph.get_query_output_port(), "truth.geometry_query")
    if world.gates_move:
        AddGateMover(builder, world, drone.state)
    if meshcat is not None:
        # The race's page moves the drone itself, and more smoothly.
        MeshcatVisualizer.AddToBuilder(
            builder, world.scene_graph, meshcat, MeshcatVisualizerParams(publish_period=0.1)
        )
    if scenario.visualization is not None:
        _visualize(builder, world)
    diagram = builder.Build()
    diagram.set_name("simulation")
    return diagram


def _visualize(builder: DiagramBuilder, world: World) -> None:
    from pydrake.visualization import ApplyVisualizationConfig, VisualizationConfig  # takes 0.15 s

    from airrace.visualization.meshcat_page import HiddenMeshcat

    config = VisualizationConfig(**vars(world.scenario.visualization))
    # Drake would make one that the network reaches.
    meshcat = HiddenMeshcat() if config.enable_meshcat_creation else None
    try:
        ApplyVisualizationConfig(
            config, builder, plant=world.plant, scene_graph=world.scene_graph, meshcat=meshcat
        )
    except (RuntimeError, SystemExit) as e:  # the last is Drake's for what must not be
        raise UserError(f"visualization cannot be used: {' '.join(str(e).split())}.") from None


def MakeMonitor(diagram: Diagram) -> Callable[[Context], None]:
    """Returns the monitor that a Simulator of a race needs.

    Where gates move, or mass and inertia are drawn and the Context has another seed than the
    scenario, these are parameters of the plant, and no system of Drake may write those of another.
    With ``simulator.set_monitor(MakeMonitor(diagram))`` they are written after each step. Without
    it, the simulation ends with an error that says so. A loop of your own may call it as well, with
    the Context of the diagram: at the start, and ten times a second, since a gate only moves when
    the drone is far from it.

    Args:
        diagram: the Simulation, or one that contains it, or several.
    """
    setters = list(_setters(diagram))

    def set_bodies(context):
        for system, plant in setters:
            system.set_bodies(
                system.GetMyMutableContextFromRoot(context),
                plant,
                plant.GetMyMutableContextFromRoot(context),
            )

    return set_bodies


def _setters(diagram: Diagram) -> Iterator[tuple[Any, MultibodyPlant]]:
    """Yields every GateMover and DrawnBody of a diagram, and its plant."""
    for system in diagram.GetSystems():
        if isinstance(system, Diagram):
            yield from _setters(system)
        elif isinstance(system, (GateMover, DrawnBody)):
            yield system, diagram.GetSubsystemByName("plant")
