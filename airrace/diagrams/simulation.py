"""The Simulation diagram: where the truth lives."""

from pydrake.geometry import Meshcat, MeshcatVisualizer, MeshcatVisualizerParams
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from airrace.diagrams.drone import AddDrone, PlaceDrone
from airrace.diagrams.world import AddGateMover, AddWorld
from airrace.rendering.scene.scenery import move_gates
from airrace.scenario import Scenario
from airrace.systems.plant.multirotor import ApplyForces


def MakeSimulation(scenario: Scenario, meshcat: Meshcat | None = None) -> Diagram:
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
    ``truth.referee_status`` (RefereeStatus), and if gates move, ``truth.gate_shifts`` (see
    GateMover), which the plant's bodies follow when follow_gates() is called; and if contacts do
    not end the race, ``truth.contacts`` (see ContactSensor).

    The drone that flies is the scenario's with the errors of its disturbances.

    Args:
        scenario: the race.
        meshcat: a Meshcat to show the world in, or None.

    Raises:
        UserError: if the track, the drone or the renderer cannot be had, or a
            rotor fails that is not there.
    """
    builder = DiagramBuilder()
    world = AddWorld(builder, scenario, shown=meshcat is not None)
    drone = PlaceDrone(world, world.track.start)
    world.plant.Finalize()
    ApplyForces(builder, world.plant, AddDrone(builder, world, drone))
    if world.gates_move:
        AddGateMover(builder, world, drone.state)
    if meshcat is not None:
        # The race's page moves the drone itself, and more smoothly.
        MeshcatVisualizer.AddToBuilder(
            builder, world.scene_graph, meshcat, MeshcatVisualizerParams(publish_period=0.1)
        )
    diagram = builder.Build()
    diagram.set_name("simulation")
    return diagram


def follow_gates(simulation: Diagram, context: Context) -> None:
    """Moves the bodies of the gates to where GateMover says that they stand.

    The loop that runs the simulation calls it ten times a second: a gate only moves when
    the drone is far from it, and no system of Drake may change the parameters of another.

    Args:
        simulation: from MakeSimulation(); if its gates stand still, nothing happens.
        context: of the diagram that is simulated.
    """
    if simulation.HasOutputPort("truth.gate_shifts"):
        port = simulation.GetOutputPort("truth.gate_shifts")
        shifts = port.Eval(simulation.GetMyContextFromRoot(context))
        plant = simulation.GetSubsystemByName("plant")
        move_gates(plant, plant.GetMyMutableContextFromRoot(context), shifts.reshape(-1, 2))
