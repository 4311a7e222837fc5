"""One drone of a simulation: its body, its rotors and sensors, and who judges it."""

import dataclasses as dc
import functools
from collections.abc import Callable
from typing import NamedTuple

from pydrake.geometry import Role
from pydrake.math import RigidTransform
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import DiagramBuilder, OutputPort, System
from pydrake.systems.primitives import DiscreteTimeDelay, DiscreteTimeIntegrator

from airrace.diagrams.world import World
from airrace.rendering.imaging.camera_effects import CameraEffects, ImagingChain
from airrace.rendering.planar.renderer import PlanarRenderer
from airrace.rendering.scene.scenery import AddPad
from airrace.rendering.vtk.vtk_renderer import AddVtkRenderer
from airrace.scenario.camera_config import NO_CAMERA
from airrace.systems.plant.drag import Drag
from airrace.systems.plant.drawn_body import DrawnBody
from airrace.systems.plant.multirotor import AddMultirotor, AddMultirotorModel, ground_clearance
from airrace.systems.plant.wind import Wind
from airrace.systems.referee import Referee
from airrace.systems.sensing.camera import Camera
from airrace.systems.sensing.contact_sensor import CONTACT_RATE, ContactSensor
from airrace.systems.sensing.imu import Imu
from airrace.systems.sensing.state_estimate import StateEstimate
from airrace.track import Start, start_pose
from airrace.vehicle import GRAVITY, Vehicle, load_vehicle
from airrace.vehicle.disturbances import check_rotors_exist, true_vehicle


class Drone(NamedTuple):
    """A drone in a World."""

    suffix: str  #: of the names of its subsystems and ports; the only drone's is empty
    vehicle: Vehicle  #: as its file says
    drawn: Callable[[int], Vehicle]  #: from a seed to the drone as it really is
    true_vehicle: Vehicle  #: that of the scenario's seed, by which the plant is made
    body: RigidBody  #: its link in the plant
    X_WB: RigidTransform  #: where it stands at the start

    @property
    def state(self) -> OutputPort:
        """The output port of the finalized plant for its floating-body state (13)."""
        return self.body.GetParentPlant().get_state_output_port(self.body.model_instance())


def PlaceDrone(world: World, start: Start, suffix: str = "") -> Drone:
    """Adds the body of a scenario's drone and its pad to a plant that is not yet finalized.

    Args: start: where it stands. suffix: see Drone.

    Raises:
        UserError: if there is no such drone, or a rotor fails that is not there.
    """
    scenario = world.scenario
    vehicle, sdf = load_vehicle(scenario.drone)
    check_rotors_exist(scenario.rotor_failures, vehicle)
    drawn = functools.partial(true_vehicle, vehicle, scenario.disturbances)
    truth = drawn(scenario.seed)
    AddPad(world.plant, start, vehicle.radius)
    body = AddMultirotorModel(world.plant, vehicle, sdf, truth)
    X_WB = start_pose(start, vehicle.radius, ground_clearance(body, world.scene_graph))
    world.plant.SetDefaultFloatingBaseBodyPose(body, X_WB)
    return Drone(suffix, vehicle, drawn, truth, body, X_WB)


def AddDrone(builder: DiagramBuilder, world: World, drone: Drone) -> list[OutputPort]:
    """Adds all that belongs to a drone, once the plant is finalized, and exports its ports.

    Returns:
        the ports of the forces on it, for ApplyForces().

    Raises:
        UserError: if the renderer of its camera cannot be had.
    """
    air = _add_air(builder, world, drone)
    rotors = _add_rotors(builder, world, drone)
    if world.scenario.camera.renderer != NO_CAMERA:
        _add_camera(builder, world, drone)
    if world.scenario.localizes:
        _add_imu(builder, world, drone)
    else:
        _add_state_estimate(builder, world, drone)
    _add_judges(builder, world, drone)
    errors = world.scenario.disturbances
    if errors.mass_error > 0.0 or errors.inertia_error > 0.0:
        seed, body = world.scenario.seed, drone.body.index()
        drawn_body = DrawnBody(body=body, drawn=drone.drawn, seed=seed)
        _add(builder, world, drone, "drawn_body", drawn_body)
    builder.ExportOutput(drone.state, "truth.state" + drone.suffix)
    return [rotors, *air]


def _add[S: System](builder: DiagramBuilder, world: World, drone: Drone, name: str, system: S) -> S:
    """Adds a system, connects what it asks of the plant and the scene, and returns it."""
    builder.AddNamedSystem(name + drone.suffix, system)
    for port, source in (
        ("state", drone.state),
        ("contact_results", world.plant.get_contact_results_output_port()),
        ("geometry_query", world.scene_graph.get_query_output_port()),
        ("seed", world.seed),
    ):
        if system.HasInputPort(port):
            builder.Connect(source, system.GetInputPort(port))
    return system


def _export(builder: DiagramBuilder, drone: Drone, system: System) -> None:
    """Exports all outputs of a system under their names."""
    for i in range(system.num_output_ports()):
        port = system.get_output_port(i)
        builder.ExportOutput(port, port.get_name() + drone.suffix)


def _add_air(builder: DiagramBuilder, world: World, drone: Drone) -> list[OutputPort]:
    """Adds wind and drag, if there are any; returns the ports of their forces."""
    config = world.scenario.disturbances
    if config.drag == 0.0:
        return []
    wind = _add(builder, world, drone, "wind", Wind(config=config.wind, seed=world.scenario.seed))
    drag = Drag(vehicle=drone.true_vehicle, share=config.drag, body_index=drone.body.index())
    _add(builder, world, drone, "drag", drag)
    builder.Connect(wind.GetOutputPort("wind"), drag.GetInputPort("wind"))
    return [drag.GetOutputPort("spatial_forces")]


def _add_rotors(builder: DiagramBuilder, world: World, drone: Drone) -> OutputPort:
    """Adds what turns rotor speed commands into forces; returns the port of these."""
    scenario = world.scenario
    rotors, forces = AddMultirotor(
        builder,
        drone.body,
        world.scene_graph,
        drone.vehicle,
        drawn=drone.drawn if scenario.disturbances.thrust_coefficient_error > 0.0 else None,
        rate=scenario.rotors.rate,
        failures=[(f.rotor - 1, f.time) for f in scenario.rotor_failures],
        visible=world.shown,
        suffix=drone.suffix,
    )
    if rotors.HasInputPort("seed"):
        builder.Connect(world.seed, rotors.GetInputPort("seed"))
    command = rotors.GetInputPort("rotor_speed_command")
    period = 1.0 / scenario.rotors.rate
    periods = scenario.disturbances.periods_of_delay(period)
    if periods:
        # Rotors that read a system of their own period see its output from before the
        # update: that is a step of delay already.
        delay = DiscreteTimeDelay(period, periods - 1, command.size())
        builder.AddNamedSystem("actuator_delay" + drone.suffix, delay)
        builder.Connect(delay.get_output_port(), command)
        command = delay.get_input_port()
    builder.ExportInput(command, "rotor_speed_command" + drone.suffix)
    for name in ("rotor_speeds", "rotor_status"):
        builder.ExportOutput(rotors.GetOutputPort(name), name + drone.suffix)
    return forces


def _add_camera(builder: DiagramBuilder, world: World, drone: Drone) -> None:
    scenario, config = world.scenario, world.scenario.camera
    effects = config.resolved()
    info = config.info(drone.vehicle.camera.X_BC)
    imaging, drawn = None, info
    if dc.replace(effects, latency=0.0) != CameraEffects():
        imaging = ImagingChain(effects=effects, camera_info=info, seed=scenario.seed)
        drawn = imaging.pinhole
    if config.renderer == "vtk":
        indoors = world.track.hall() is not None
        renderer = AddVtkRenderer(world.scene_graph, drawn, indoors=indoors)
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
    _export(builder, drone, _add(builder, world, drone, "camera", camera))


def _add_imu(builder: DiagramBuilder, world: World, drone: Drone) -> None:
    scenario, config = world.scenario, world.scenario.imu
    imu = Imu(
        rate=config.rate,
        errors=config.resolved(),
        position=drone.vehicle.imu.position,
        failures=scenario.imu_failures,
        state_period=scenario.plant_config.time_step,
    )
    _export(builder, drone, _add(builder, world, drone, "imu", imu))


def _add_state_estimate(builder: DiagramBuilder, world: World, drone: Drone) -> None:
    scenario, config = world.scenario, world.scenario.state_estimate
    noisy = scenario.state_noise != "none"
    estimate = StateEstimate(
        rate=config.rate,
        position_sigma=noisy * config.position_sigma,
        velocity_sigma=noisy * config.velocity_sigma,
        state_period=scenario.plant_config.time_step,
    )
    _export(builder, drone, _add(builder, world, drone, "state_estimate", estimate))


def _add_judges(builder: DiagramBuilder, world: World, drone: Drone) -> None:
    """Adds the referee, and what counts contacts where they do not end the race.

    They are shown every contact of the drone, however short, in the impulse of all of them.
    """
    scenario, plant, config = world.scenario, world.plant, world.scenario.referee
    names, standing_height = _names_of_others(world, drone), drone.X_WB.translation()[2]
    referee = Referee(
        track=world.track,
        laps=scenario.laps,
        period=1.0 / config.rate,
        time_limit=config.time_limit or 600.0 + 120.0 * scenario.laps,
        arena_margin=config.arena_margin,
        standing_height=standing_height,
        body_names=names,
        rotor_failures=scenario.rotor_failures,
        moving_gates=world.gates_move,
        contacts_end=config.contacts_end,
    )
    impulse = DiscreteTimeIntegrator(6, plant.time_step())
    builder.AddNamedSystem("contact_impulse" + drone.suffix, impulse)
    forces = plant.get_generalized_contact_forces_output_port(drone.body.model_instance())
    builder.Connect(forces, impulse.get_input_port())
    _add(builder, world, drone, "referee", referee)
    builder.Connect(impulse.get_output_port(), referee.GetInputPort("contact_impulse"))
    builder.ExportInput(referee.GetInputPort("explorer_status"), "explorer_status" + drone.suffix)
    builder.ExportOutput(
        referee.GetOutputPort("referee_status"), "truth.referee_status" + drone.suffix
    )
    if not config.contacts_end:
        sensor = ContactSensor(
            rate=CONTACT_RATE,
            standing_height=standing_height,
            weight=drone.true_vehicle.mass * GRAVITY,
            body_names=names,
        )
        _add(builder, world, drone, "contact_sensor", sensor)
        builder.Connect(impulse.get_output_port(), sensor.GetInputPort("contact_impulse"))
        builder.ExportOutput(sensor.GetOutputPort("contacts"), "truth.contacts" + drone.suffix)


def _names_of_others(world: World, drone: Drone) -> dict:
    """Maps the IDs of everything that a drone can hit to its plain name."""
    inspector = world.scene_graph.model_inspector()
    own = world.plant.GetBodyFrameIdOrThrow(drone.body.index())
    return {
        geometry_id: inspector.GetName(geometry_id).split("::")[-1]
        for frame_id in inspector.GetAllFrameIds()
        if frame_id != own
        for geometry_id in inspector.GetGeometries(frame_id, Role.kProximity)
    }
