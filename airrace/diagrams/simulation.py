"""The Simulation diagram: where the truth lives."""

import dataclasses as dc

import numpy as np
from pydrake.geometry import MeshcatVisualizer, MeshcatVisualizerParams, Role, SceneGraph
from pydrake.multibody.plant import AddMultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import DiscreteTimeDelay, DiscreteTimeIntegrator

from airrace.rendering.imaging.camera_effects import CameraEffects, ImagingChain
from airrace.rendering.planar.renderer import PlanarRenderer
from airrace.rendering.scene.pad import AddPad, start_pose
from airrace.rendering.scene.scenery import AddScenery, move_gates
from airrace.rendering.vtk.vtk_renderer import AddVtkRenderer
from airrace.scenario import Scenario
from airrace.scenario.camera import NO_CAMERA
from airrace.systems.plant.drag import Drag
from airrace.systems.plant.gate_mover import GateMover
from airrace.systems.plant.multirotor import AddMultirotor, AddMultirotorModel, ground_clearance
from airrace.systems.plant.wind import Wind
from airrace.systems.referee import Referee
from airrace.systems.sensing.camera import Camera
from airrace.systems.sensing.state_estimate import StateEstimate
from airrace.systems.types import make_camera_info
from airrace.track import load_track
from airrace.vehicle import Vehicle, load_vehicle
from airrace.vehicle.disturbances import check_rotors_exist, true_vehicle


def MakeSimulation(scenario: Scenario, meshcat=None) -> Diagram:
    """Builds the simulated world of a scenario.

    Input ports: ``rotor_speed_command`` (vector, rad/s) and
    ``explorer_status`` (ExplorerStatus), the team's word that it races.
    Output ports for the autonomy: ``camera_image`` (ImageRgba8U),
    ``camera_grey`` (the same picture, ImageGrey8U), ``camera_view`` (it once more,
    drawn where somebody looks, CameraView),
    ``camera_image_time`` (s), ``camera_info`` (CameraInfo), ``state_estimate``
    (see systems/state_estimate.py), ``rotor_speeds`` (rad/s) and
    ``rotor_status`` (see RotorBank) of the motor controllers. Truth, for judges
    and spectators only: ``truth.state`` (13), ``truth.referee_status``
    (RefereeStatus), and if gates move, ``truth.gate_shifts`` (see GateMover),
    which the plant's bodies follow when follow_gates() is called.

    The drone that flies is the scenario's with the errors of its disturbances.

    Args:
        scenario: the race.
        meshcat: a Meshcat to show the world in, or None.

    Raises:
        UserError: if the track, the drone or the renderer cannot be had, or a
            rotor fails that is not there.
    """
    track = load_track(scenario.track)
    vehicle, sdf = load_vehicle(scenario.drone)
    check_rotors_exist(scenario.rotor_failures, vehicle)
    truth = true_vehicle(vehicle, scenario.disturbances, scenario.seed)
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlant(scenario.plant_config, builder)
    moving = scenario.disturbances.gate_shift > 0.0
    seen = meshcat is not None or scenario.camera.renderer == "vtk"
    AddScenery(plant, track, movable=moving, visible=seen)
    AddPad(plant, track.start, vehicle.radius)
    AddMultirotorModel(plant, vehicle, sdf, truth)
    plant.Finalize()
    X_WB = start_pose(track.start, vehicle.radius, ground_clearance(plant, scene_graph))
    plant.SetDefaultFloatingBaseBodyPose(plant.GetBodyByName("body"), X_WB)
    state = plant.get_state_output_port(plant.GetBodyByName("body").model_instance())
    rotors = AddMultirotor(
        builder,
        plant,
        scene_graph,
        truth,
        rate=scenario.rotors.rate,
        failures=[(f.rotor - 1, f.time) for f in scenario.rotor_failures],
        forces=_add_air(builder, plant, state, truth, scenario),
        visible=meshcat is not None,
    )
    command = _add_delay(
        builder,
        rotors.GetInputPort("rotor_speed_command"),
        delay=scenario.disturbances.actuator_delay,
        period=1.0 / scenario.rotors.rate,
    )

    camera = None
    if scenario.camera.renderer != NO_CAMERA:
        camera = _add_camera(builder, scene_graph, scenario, track, vehicle)
        builder.Connect(state, camera.GetInputPort("state"))
    noisy = scenario.state_noise != "none"
    estimate = builder.AddNamedSystem(
        "state_estimate",
        StateEstimate(
            rate=scenario.state_estimate.rate,
            position_sigma=noisy * scenario.state_estimate.position_sigma,
            velocity_sigma=noisy * scenario.state_estimate.velocity_sigma,
            seed=scenario.seed,
            state_period=scenario.plant_config.time_step,
        ),
    )
    builder.Connect(state, estimate.GetInputPort("state"))
    referee = builder.AddNamedSystem(
        "referee",
        Referee(
            track=track,
            laps=scenario.laps,
            period=1.0 / scenario.referee.rate,
            time_limit=scenario.referee.time_limit or 600.0 + 120.0 * scenario.laps,
            arena_margin=scenario.referee.arena_margin,
            standing_height=X_WB.translation()[2],
            body_names=_collision_names(plant, scene_graph),
            rotor_failures=scenario.rotor_failures,
            moving_gates=moving,
        ),
    )
    builder.Connect(state, referee.GetInputPort("state"))
    _connect_contacts(builder, plant, scene_graph, referee)
    if moving:
        mover = builder.AddNamedSystem(
            "gate_mover",
            GateMover(track=track, max_shift=scenario.disturbances.gate_shift, seed=scenario.seed),
        )
        builder.Connect(state, mover.GetInputPort("state"))
        for system in (camera, referee):
            if system is not None and system.HasInputPort("gate_shifts"):
                builder.Connect(
                    mover.GetOutputPort("gate_shifts"), system.GetInputPort("gate_shifts")
                )
        builder.ExportOutput(mover.GetOutputPort("gate_shifts"), "truth.gate_shifts")
    if meshcat is not None:
        MeshcatVisualizer.AddToBuilder(
            builder, scene_graph, meshcat, MeshcatVisualizerParams(publish_period=1 / 30)
        )

    builder.ExportInput(command, "rotor_speed_command")
    builder.ExportInput(referee.GetInputPort("explorer_status"), "explorer_status")
    for i in range(camera.num_output_ports() if camera is not None else 0):
        port = camera.get_output_port(i)
        builder.ExportOutput(port, port.get_name())
    builder.ExportOutput(estimate.GetOutputPort("state_estimate"), "state_estimate")
    for name in ("rotor_speeds", "rotor_status"):
        builder.ExportOutput(rotors.GetOutputPort(name), name)
    builder.ExportOutput(state, "truth.state")
    builder.ExportOutput(referee.GetOutputPort("report"), "truth.referee_status")
    diagram = builder.Build()
    diagram.set_name("simulation")
    return diagram


def follow_gates(simulation: Diagram, context) -> None:
    """Moves the bodies of the gates to where GateMover says that they stand.

    Who runs the simulation calls it now and then: a gate only moves when the drone
    is far from it, and no system of Drake may change the parameters of another.

    Args:
        simulation: from MakeSimulation(); if its gates stand still, nothing happens.
        context: of the diagram that is simulated.
    """
    if simulation.HasOutputPort("truth.gate_shifts"):
        port = simulation.GetOutputPort("truth.gate_shifts")
        shifts = port.Eval(simulation.GetMyContextFromRoot(context))
        plant = simulation.GetSubsystemByName("plant")
        move_gates(plant, plant.GetMyMutableContextFromRoot(context), shifts.reshape(-1, 2))


def _add_air(builder, plant, state, vehicle: Vehicle, scenario) -> list:
    """Adds wind and drag; returns the output ports of their forces, if any."""
    config = scenario.disturbances
    if config.drag == 0.0:
        return []
    wind = builder.AddNamedSystem("wind", Wind(config=config.wind, seed=scenario.seed))
    body_index = plant.GetBodyByName("body").index()
    drag = builder.AddNamedSystem(
        "drag", Drag(vehicle=vehicle, share=config.drag, body_index=body_index)
    )
    builder.Connect(state, drag.GetInputPort("state"))
    builder.Connect(wind.GetOutputPort("wind"), drag.GetInputPort("wind"))
    return [drag.GetOutputPort("spatial_forces")]


def _connect_contacts(builder, plant, scene_graph: SceneGraph, referee: Referee) -> None:
    """Shows the referee every contact of the drone, however short."""
    drone = plant.GetBodyByName("body").model_instance()
    impulse = builder.AddNamedSystem(
        "contact_impulse", DiscreteTimeIntegrator(6, plant.time_step())
    )
    builder.Connect(
        plant.get_generalized_contact_forces_output_port(drone), impulse.get_input_port()
    )
    for port, name in (
        (impulse.get_output_port(), "contact_impulse"),
        (plant.get_contact_results_output_port(), "contact_results"),
        (scene_graph.get_query_output_port(), "geometry_query"),
    ):
        builder.Connect(port, referee.GetInputPort(name))


def _add_delay(builder, port, *, delay: float, period: float):
    """Adds a delay (s) before an input port; returns the port that is then open."""
    if delay == 0.0:
        return port
    # What looks at a system of the same period sees it before its update, which
    # is a step of delay already.
    steps = max(1, round(delay / period)) - 1
    box = builder.AddNamedSystem("actuator_delay", DiscreteTimeDelay(period, steps, port.size()))
    builder.Connect(box.get_output_port(), port)
    return box.get_input_port()


def _add_camera(builder, scene_graph: SceneGraph, scenario, track, vehicle: Vehicle) -> Camera:
    config = scenario.camera
    effects = config.resolved()
    info = make_camera_info(
        width=config.width,
        height=config.height,
        fov_y=np.deg2rad(config.fov_y_deg),
        X_BC=vehicle.camera.X_BC,
        D=effects.distortion,
    )
    imaging, drawn = None, info
    if dc.replace(effects, latency=0.0) != CameraEffects():
        imaging = ImagingChain(effects=effects, camera_info=info, seed=scenario.seed)
        drawn = imaging.pinhole
    if config.renderer == "vtk":
        renderer = AddVtkRenderer(scene_graph, drawn)
    else:
        renderer = PlanarRenderer(track, drawn)
    camera = builder.AddNamedSystem(
        "camera",
        Camera(
            camera_info=info,
            fps=config.fps,
            renderer=renderer,
            imaging=imaging,
            latency=effects.latency,
            moving_gates=len(track.gates) if scenario.disturbances.gate_shift else 0,
            state_period=scenario.plant_config.time_step,
        ),
    )
    if renderer.needs_query_object:
        builder.Connect(scene_graph.get_query_output_port(), camera.GetInputPort("geometry_query"))
    return camera


def _collision_names(plant, scene_graph: SceneGraph) -> dict:
    """Maps the IDs of everything that the drone can hit to its plain name."""
    inspector = scene_graph.model_inspector()
    drone = plant.GetBodyFrameIdOrThrow(plant.GetBodyByName("body").index())
    return {
        geometry_id: inspector.GetName(geometry_id).split("::")[-1]
        for frame_id in inspector.GetAllFrameIds()
        if frame_id != drone
        for geometry_id in inspector.GetGeometries(frame_id, Role.kProximity)
    }
