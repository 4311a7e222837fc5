"""The Simulation diagram: where the truth lives."""

import dataclasses as dc
from typing import NamedTuple

import numpy as np
from pydrake.geometry import Meshcat, MeshcatVisualizer, MeshcatVisualizerParams, Role, SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, OutputPort
from pydrake.systems.primitives import DiscreteTimeDelay, DiscreteTimeIntegrator

from airrace.common.errors import UserError
from airrace.rendering.imaging.camera_effects import CameraEffects, ImagingChain
from airrace.rendering.planar.renderer import PlanarRenderer
from airrace.rendering.scene.pad import AddPad
from airrace.rendering.scene.scenery import AddScenery, move_gates
from airrace.rendering.vtk.vtk_renderer import AddVtkRenderer
from airrace.scenario import VIO, Scenario
from airrace.scenario.camera_config import NO_CAMERA
from airrace.systems.plant.drag import Drag
from airrace.systems.plant.gate_mover import GateMover
from airrace.systems.plant.multirotor import AddMultirotor, AddMultirotorModel, ground_clearance
from airrace.systems.plant.wind import Wind
from airrace.systems.referee import Referee
from airrace.systems.sensing.camera import Camera
from airrace.systems.sensing.contact_sensor import ContactSensor
from airrace.systems.sensing.imu import Imu
from airrace.systems.sensing.state_estimate import StateEstimate
from airrace.track import Course, load_track, start_pose
from airrace.vehicle import GRAVITY, Vehicle, load_vehicle
from airrace.vehicle.camera_info import make_camera_info
from airrace.vehicle.disturbances import check_rotors_exist, true_vehicle

CONTACT_RATE = 120.0  # Hz, of the contact sensor


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
    world = _add_world(builder, scenario, meshcat)
    _add_rotors(builder, world, forces=_add_air(builder, world))
    if scenario.camera.renderer != NO_CAMERA:
        _add_camera(builder, world)
    if scenario.estimator == VIO:
        _add_imu(builder, world)
    else:
        _add_state_estimate(builder, world)
    _add_referee(builder, world)
    if world.gates_move:
        _add_gate_mover(builder, world)
    if meshcat is not None:
        # The race's page moves the drone itself, and more smoothly.
        MeshcatVisualizer.AddToBuilder(
            builder, world.scene_graph, meshcat, MeshcatVisualizerParams(publish_period=0.1)
        )
    builder.ExportOutput(world.state, "truth.state")
    diagram = builder.Build()
    diagram.set_name("simulation")
    return diagram


class _World(NamedTuple):
    """What everything in the simulation is built on.

    Attributes:
        vehicle: the drone as its file says; true_vehicle: as it really is.
        X_WB: where it stands at the start.
        state: the plant's output port of its floating-body state (13).
        shown: whether somebody watches in Meshcat.
    """

    scenario: Scenario
    track: Course
    vehicle: Vehicle
    true_vehicle: Vehicle
    plant: MultibodyPlant
    scene_graph: SceneGraph
    X_WB: RigidTransform
    state: OutputPort
    shown: bool

    @property
    def gates_move(self) -> bool:
        """Whether gates move between laps."""
        return self.scenario.disturbances.gate_shift > 0.0


def _add_world(builder: DiagramBuilder, scenario: Scenario, meshcat: Meshcat | None) -> _World:
    """Adds the plant and its scene: the track, the pad and the drone's body."""
    track = load_track(scenario.track)
    vehicle, sdf = load_vehicle(scenario.drone)
    check_rotors_exist(scenario.rotor_failures, vehicle)
    truth = true_vehicle(vehicle, scenario.disturbances, scenario.seed)
    plant, scene_graph = AddMultibodyPlant(scenario.plant_config, builder)
    visible = meshcat is not None or scenario.camera.renderer == "vtk"
    movable = scenario.disturbances.gate_shift > 0.0
    if movable and not track.closed:
        raise UserError(
            f"The gates of {track.name} are passed only once, and do not move between laps: set "
            "disturbances.gate_shift to 0."
        )
    AddScenery(plant, track, movable=movable, visible=visible)
    AddPad(plant, track.start, vehicle.radius)
    AddMultirotorModel(plant, vehicle, sdf, truth)
    plant.Finalize()
    body = plant.GetBodyByName("body")
    X_WB = start_pose(track.start, vehicle.radius, ground_clearance(plant, scene_graph))
    plant.SetDefaultFloatingBaseBodyPose(body, X_WB)
    state = plant.get_state_output_port(body.model_instance())
    return _World(
        scenario, track, vehicle, truth, plant, scene_graph, X_WB, state, meshcat is not None
    )


def _add_air(builder: DiagramBuilder, world: _World) -> list[OutputPort]:
    """Adds wind and drag, if there are any; returns the ports of their forces."""
    config = world.scenario.disturbances
    if config.drag == 0.0:
        return []
    wind = builder.AddNamedSystem("wind", Wind(config=config.wind, seed=world.scenario.seed))
    body_index = world.plant.GetBodyByName("body").index()
    drag = Drag(vehicle=world.true_vehicle, share=config.drag, body_index=body_index)
    builder.AddNamedSystem("drag", drag)
    builder.Connect(world.state, drag.GetInputPort("state"))
    builder.Connect(wind.GetOutputPort("wind"), drag.GetInputPort("wind"))
    return [drag.GetOutputPort("spatial_forces")]


def _add_rotors(builder: DiagramBuilder, world: _World, forces: list[OutputPort]) -> None:
    """Adds what turns rotor speed commands, and the air's forces, into motion of the plant."""
    scenario = world.scenario
    rotors = AddMultirotor(
        builder,
        world.plant,
        world.scene_graph,
        world.true_vehicle,
        rate=scenario.rotors.rate,
        failures=[(f.rotor - 1, f.time) for f in scenario.rotor_failures],
        forces=forces,
        visible=world.shown,
    )
    command = rotors.GetInputPort("rotor_speed_command")
    period = 1.0 / scenario.rotors.rate
    periods = scenario.disturbances.periods_of_delay(period)
    if periods:
        # Rotors that read a system of their own period see its output from before the
        # update: that is a step of delay already.
        delay = DiscreteTimeDelay(period, periods - 1, command.size())
        builder.AddNamedSystem("actuator_delay", delay)
        builder.Connect(delay.get_output_port(), command)
        command = delay.get_input_port()
    builder.ExportInput(command, "rotor_speed_command")
    for name in ("rotor_speeds", "rotor_status"):
        builder.ExportOutput(rotors.GetOutputPort(name), name)


def _add_camera(builder: DiagramBuilder, world: _World) -> None:
    scenario, config = world.scenario, world.scenario.camera
    effects = config.resolved()
    info = make_camera_info(
        width=config.width,
        height=config.height,
        fov_y=np.deg2rad(config.fov_y_deg),
        X_BC=world.vehicle.camera.X_BC,
        D=effects.distortion,
    )
    imaging, drawn = None, info
    if dc.replace(effects, latency=0.0) != CameraEffects():
        imaging = ImagingChain(effects=effects, camera_info=info, seed=scenario.seed)
        drawn = imaging.pinhole
    if config.renderer == "vtk":
        renderer = AddVtkRenderer(world.scene_graph, drawn, indoors=world.track.hall() is not None)
    else:
        renderer = PlanarRenderer(world.track, drawn)
    camera = Camera(
        camera_info=info,
        fps=config.fps,
        renderer=renderer,
        imaging=imaging,
        latency=effects.latency,
        moving_gates=len(world.track.gates) if world.gates_move else 0,
        failures=scenario.camera_failures,
        state_period=scenario.plant_config.time_step,
    )
    builder.AddNamedSystem("camera", camera)
    builder.Connect(world.state, camera.GetInputPort("state"))
    if renderer.needs_query_object:
        query = world.scene_graph.get_query_output_port()
        builder.Connect(query, camera.GetInputPort("geometry_query"))
    for i in range(camera.num_output_ports()):
        port = camera.get_output_port(i)
        builder.ExportOutput(port, port.get_name())


def _add_imu(builder: DiagramBuilder, world: _World) -> None:
    scenario, config = world.scenario, world.scenario.imu
    imu = Imu(
        rate=config.rate,
        errors=config.resolved(),
        position=world.vehicle.imu.position,
        failures=scenario.imu_failures,
        seed=scenario.seed,
        state_period=scenario.plant_config.time_step,
    )
    builder.AddNamedSystem("imu", imu)
    builder.Connect(world.state, imu.GetInputPort("state"))
    builder.ExportOutput(imu.GetOutputPort("imu"), "imu")


def _add_state_estimate(builder: DiagramBuilder, world: _World) -> None:
    scenario, config = world.scenario, world.scenario.state_estimate
    noisy = scenario.state_noise != "none"
    estimate = StateEstimate(
        rate=config.rate,
        position_sigma=noisy * config.position_sigma,
        velocity_sigma=noisy * config.velocity_sigma,
        seed=scenario.seed,
        state_period=scenario.plant_config.time_step,
    )
    builder.AddNamedSystem("state_estimate", estimate)
    builder.Connect(world.state, estimate.GetInputPort("state"))
    builder.ExportOutput(estimate.GetOutputPort("state_estimate"), "state_estimate")


def _add_referee(builder: DiagramBuilder, world: _World) -> None:
    """Adds the referee, who is shown every contact of the drone, however short."""
    scenario, plant, scene_graph = world.scenario, world.plant, world.scene_graph
    config = scenario.referee
    referee = Referee(
        track=world.track,
        laps=scenario.laps,
        period=1.0 / config.rate,
        time_limit=config.time_limit or 600.0 + 120.0 * scenario.laps,
        arena_margin=config.arena_margin,
        standing_height=world.X_WB.translation()[2],
        body_names=_collision_names(plant, scene_graph),
        rotor_failures=scenario.rotor_failures,
        moving_gates=world.gates_move,
        contacts_end=config.contacts_end,
    )
    builder.AddNamedSystem("referee", referee)
    builder.Connect(world.state, referee.GetInputPort("state"))
    impulse = DiscreteTimeIntegrator(6, plant.time_step())
    builder.AddNamedSystem("contact_impulse", impulse)
    drone = plant.GetBodyByName("body").model_instance()
    forces = plant.get_generalized_contact_forces_output_port(drone)
    builder.Connect(forces, impulse.get_input_port())
    for port, name in (
        (impulse.get_output_port(), "contact_impulse"),
        (plant.get_contact_results_output_port(), "contact_results"),
        (scene_graph.get_query_output_port(), "geometry_query"),
    ):
        builder.Connect(port, referee.GetInputPort(name))
    if not config.contacts_end:
        _add_contact_sensor(builder, world, impulse.get_output_port())
    builder.ExportInput(referee.GetInputPort("explorer_status"), "explorer_status")
    builder.ExportOutput(referee.GetOutputPort("report"), "truth.referee_status")


def _add_contact_sensor(builder: DiagramBuilder, world: _World, impulse: OutputPort) -> None:
    """Adds what counts contacts where the referee does not; impulse: of all contacts so far."""
    plant, scene_graph = world.plant, world.scene_graph
    sensor = ContactSensor(
        rate=CONTACT_RATE,
        standing_height=world.X_WB.translation()[2],
        weight=world.true_vehicle.mass * GRAVITY,
        body_names=_collision_names(plant, scene_graph),
    )
    builder.AddNamedSystem("contact_sensor", sensor)
    for port, name in (
        (world.state, "state"),
        (impulse, "contact_impulse"),
        (plant.get_contact_results_output_port(), "contact_results"),
        (scene_graph.get_query_output_port(), "geometry_query"),
    ):
        builder.Connect(port, sensor.GetInputPort(name))
    builder.ExportOutput(sensor.GetOutputPort("contacts"), "truth.contacts")


def _collision_names(plant: MultibodyPlant, scene_graph: SceneGraph) -> dict:
    """Maps the IDs of everything that the drone can hit to its plain name."""
    inspector = scene_graph.model_inspector()
    drone = plant.GetBodyFrameIdOrThrow(plant.GetBodyByName("body").index())
    return {
        geometry_id: inspector.GetName(geometry_id).split("::")[-1]
        for frame_id in inspector.GetAllFrameIds()
        if frame_id != drone
        for geometry_id in inspector.GetGeometries(frame_id, Role.kProximity)
    }


def _add_gate_mover(builder: DiagramBuilder, world: _World) -> None:
    """Adds what moves gates between laps, and shows it to every system that has a port for it."""
    max_shift = world.scenario.disturbances.gate_shift
    mover = GateMover(track=world.track, max_shift=max_shift, seed=world.scenario.seed)
    builder.AddNamedSystem("gate_mover", mover)
    builder.Connect(world.state, mover.GetInputPort("state"))
    shifts = mover.GetOutputPort("gate_shifts")
    for system in builder.GetSystems():
        if system.HasInputPort("gate_shifts"):
            builder.Connect(shifts, system.GetInputPort("gate_shifts"))
    builder.ExportOutput(shifts, "truth.gate_shifts")


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
