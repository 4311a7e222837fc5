"""The Autonomy diagram: from pixels to rotor speeds, without the truth.

It has two halves. The pilot controls, at hundreds of hertz; the navigator sees, maps, explores and
plans, which takes as long as it takes. In SITL and in lockstep both are in one diagram. In real
time each has a diagram, and a process, of its own, so that the drone is controlled while it thinks.
"""

import importlib
import traceback
from collections.abc import Collection
from pathlib import Path

from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort, System

from airrace.common.errors import UserError
from airrace.common.resources import models_path
from airrace.scenario import LEARNED, PLANNED, VIO, Scenario
from airrace.scenario.camera_config import NO_CAMERA
from airrace.systems.control.geometric_controller import GeometricController
from airrace.systems.control.learned_pilot import LearnedPilot
from airrace.systems.control.pilot_switch import PilotSwitch
from airrace.systems.control.policy_network import load_policy
from airrace.systems.control.rate_controller import RateController
from airrace.systems.control.rotor_monitor import RotorMonitor
from airrace.systems.control.state_filter import StateFilter, UnfilteredState
from airrace.systems.estimation.of_scenario import make_gate_slam, make_strapdown_integrator
from airrace.systems.exploring.explorer import Explorer
from airrace.systems.mapping.gate_mapper import GateMapper
from airrace.systems.mapping.known_map import KnownMap, NoDetector
from airrace.systems.perception.aruco_detector import ArucoDetector
from airrace.systems.perception.detector_config import DetectorConfig
from airrace.systems.perception.rectifier import Rectifier
from airrace.systems.planning.lap_planner import LapPlanner
from airrace.systems.planning.trajectory_tracker import TrajectoryTracker
from airrace.track import load_track
from airrace.track.map_files import read_map
from airrace.trajopt.errors import TrajectoryOptimizationError
from airrace.trajopt.feasibility import clearance_of
from airrace.vehicle import load_vehicle


def _make_aruco_detector(scenario: Scenario) -> System:
    if scenario.map:
        return NoDetector()
    perception = scenario.perception
    config = DetectorConfig(
        corners=perception.corners, poses=perception.poses, jump_filter=perception.jump_filter
    )
    return ArucoDetector(fps=scenario.camera.fps, config=config)


def _make_gate_mapper(scenario: Scenario) -> System:
    if scenario.map:
        return KnownMap(read_map(scenario.map, scenario.track))
    return GateMapper(
        fps=scenario.camera.fps,
        # The mapper counts from the exposure.
        latency=scenario.perception.latency + scenario.camera.resolved().latency,
        state_rate=scenario.state_estimate.rate,
        link_delay=scenario.link_delay,
        config=scenario.perception,
    )


def _make_explorer(scenario: Scenario) -> Explorer:
    return Explorer(
        config=scenario.explorer,
        # The hover height is a rule of the race; nothing else of the track is read.
        hover_height=load_track(scenario.track, markers=True).hover_height,
        clearance=clearance_of(load_vehicle(scenario.drone)[0].radius),  # type: ignore[arg-type]
        map_is_known=bool(scenario.map),
        vio=scenario.estimator == VIO,
    )


def _make_lap_planner(scenario: Scenario) -> LapPlanner:
    try:
        return LapPlanner(
            vehicle=load_vehicle(scenario.drone)[0],
            trajectory=scenario.trajectory,
            config=scenario.planner,
            laps=scenario.laps,
            learned=scenario.pilot != PLANNED,
        )
    except TrajectoryOptimizationError as e:
        raise UserError(f"The lap planner cannot be: {e} Raise planner.thrust_share.") from None


def _make_rotor_monitor(scenario: Scenario) -> RotorMonitor:
    return RotorMonitor(vehicle=load_vehicle(scenario.drone)[0], rate=scenario.rotor_monitor.rate)


def _make_state_filter(scenario: Scenario) -> System:
    if not scenario.state_filter.enabled:
        return UnfilteredState()
    return StateFilter(
        vehicle=load_vehicle(scenario.drone)[0],
        state_rate=scenario.state_estimate.rate,
        rate=scenario.state_filter.rate,
    )


def _make_geometric_controller(scenario: Scenario) -> GeometricController:
    return GeometricController(vehicle=load_vehicle(scenario.drone)[0], **vars(scenario.controller))


def _make_learned_pilot(scenario: Scenario) -> LearnedPilot:
    vehicle, _ = load_vehicle(scenario.drone)
    path = Path(scenario.pilot)
    if scenario.pilot == LEARNED:
        path = models_path() / "pilots" / f"{vehicle.name}.npz"
        if not path.exists():
            raise UserError(
                f"There is no learned pilot for the drone {vehicle.name}: train one with "
                "examples/train_pilot.py and name its file, or race with --pilot planned."
            )
    return LearnedPilot(vehicle=vehicle, network=load_policy(path, vehicle))


def _make_rate_controller(scenario: Scenario) -> RateController:
    return RateController(vehicle=load_vehicle(scenario.drone)[0], rate=scenario.controller.rate)


def _make_pilot_switch(scenario: Scenario) -> PilotSwitch:
    return PilotSwitch(rotors=len(load_vehicle(scenario.drone)[0].rotors))


def _make_trajectory_tracker(scenario: Scenario) -> TrajectoryTracker:
    return TrajectoryTracker(vio=scenario.estimator == VIO, learned=scenario.pilot != PLANNED)


# Every system, and what makes it unless the scenario's `systems` names another.
SYSTEMS = {
    "aruco_detector": _make_aruco_detector,
    "gate_mapper": _make_gate_mapper,
    "explorer": _make_explorer,
    "lap_planner": _make_lap_planner,
    "trajectory_tracker": _make_trajectory_tracker,
    "rotor_monitor": _make_rotor_monitor,
    "state_filter": _make_state_filter,
    "geometric_controller": _make_geometric_controller,
}
# With the estimator `vio` there is no gate_mapper and no state_filter; these take their places.
VIO_SYSTEMS = {"gate_slam": make_gate_slam, "strapdown_integrator": make_strapdown_integrator}
_REPLACED = ("gate_mapper", "state_filter")
# With a pilot that was learned, there are these, too.
LEARNED_SYSTEMS = {
    "learned_pilot": _make_learned_pilot,
    "rate_controller": _make_rate_controller,
    "pilot_switch": _make_pilot_switch,
}
# The systems of the pilot; all others are the navigator's.
PILOT = (
    "trajectory_tracker",
    "rotor_monitor",
    "state_filter",
    "strapdown_integrator",
    "geometric_controller",
    *LEARNED_SYSTEMS,
)
INPUTS = (
    "camera_image",
    "camera_grey",
    "camera_view",
    "camera_image_time",
    "camera_info",
    "state_estimate",
    "rotor_speeds",
    "rotor_status",
)
OUTPUTS = {
    "rotor_speed_command": "geometric_controller",
    "reference": "trajectory_tracker",
    "filtered_estimate": "state_filter",
    "disturbance": "state_filter",
    "rotor_losses": "rotor_monitor",
    "lap_plan": "lap_planner",
    "exploration_reference": "explorer",
    "explorer_status": "explorer",
    "gate_map": "gate_mapper",
    "detections": "aruco_detector",
}
_RECTIFIED = ("camera_image", "camera_grey", "camera_view", "camera_info")
VIO_INPUTS = tuple("imu" if name == "state_estimate" else name for name in INPUTS)
VIO_OUTPUTS = OUTPUTS | {
    "filtered_estimate": "strapdown_integrator",
    "disturbance": "strapdown_integrator",
    "state_estimate": "strapdown_integrator",
    "imu_history": "strapdown_integrator",
    "imu_silence": "strapdown_integrator",
    "estimate_fault": "gate_slam",
    "estimate_drift": "gate_slam",
    "gate_map": "gate_slam",
    "corrections": "gate_slam",
    "slam_state": "gate_slam",
}
# A colon names the port of the system, where it goes by another name: both controllers command
# rotors, and the switch says whom these hear.
LEARNED_OUTPUTS = {
    "rotor_speed_command": "pilot_switch",
    "planned_command": "geometric_controller:rotor_speed_command",
    "learned_command": "rate_controller:rotor_speed_command",
    "rate_command": "learned_pilot",
    "network_flies": "learned_pilot",
    "safe_reference": "learned_pilot",
    "pilot_status": "learned_pilot",
}


def systems_of(scenario: Scenario) -> dict:
    """Returns the name of every system of a scenario's autonomy, and what makes it."""
    systems = SYSTEMS
    if scenario.estimator == VIO:
        kept = {name: make for name, make in SYSTEMS.items() if name not in _REPLACED}
        systems = kept | VIO_SYSTEMS
    return systems if scenario.pilot == PLANNED else systems | LEARNED_SYSTEMS


def MakeAutonomy(scenario: Scenario) -> Diagram:
    """Builds the autonomy of a scenario.

    The ports carry the names of what they carry, and ports of the same name
    are connected: INPUTS come from the Simulation, OUTPUTS from the systems
    that make them. All OUTPUTS are also outputs of the diagram. If the camera's
    lens distorts, a Rectifier stands between its images and every system.

    With the estimator ``vio`` nothing tells the autonomy where it is: there is no input
    ``state_estimate``, but an ``imu``; see VIO_SYSTEMS, VIO_INPUTS and VIO_OUTPUTS.

    Args:
        scenario: the race; of its track, only the hover height is used.

    Raises:
        UserError: if a system of the scenario cannot be had or does not fit.
    """
    return _make_part("autonomy", scenario, list(systems_of(scenario)))


def MakePilot(scenario: Scenario, given: Collection[str] = ()) -> Diagram:
    """Builds the half of the autonomy that controls: see MakeAutonomy() and PILOT.

    What its systems get from the navigator's are inputs of the diagram.

    Args:
        scenario: the race.
        given: which of its own OUTPUTS its systems get from outside instead.
    """
    names = [name for name in systems_of(scenario) if name in PILOT]
    return _make_part("pilot", scenario, names, given)


def MakeNavigator(scenario: Scenario) -> Diagram:
    """Builds the other half of the autonomy: what sees, maps, explores and plans.

    What its systems get from the pilot's are inputs of the diagram. Args: scenario: the race.
    """
    names = [name for name in systems_of(scenario) if name not in PILOT]
    return _make_part("navigator", scenario, names)


def _make_part(
    part: str, scenario: Scenario, names: list[str], given: Collection[str] = ()
) -> Diagram:
    """Builds the diagram of some of the systems; the ports of the others are inputs of it."""
    every = systems_of(scenario)
    for name in scenario.systems:
        if name not in every:
            raise UserError(
                f"systems.{name} is not a system of the autonomy; there are: {', '.join(every)}."
            )
    systems = {name: make_system(name, scenario) for name in names}
    inputs, outputs = (VIO_INPUTS, VIO_OUTPUTS) if scenario.estimator == VIO else (INPUTS, OUTPUTS)
    if scenario.pilot != PLANNED:
        outputs = outputs | LEARNED_OUTPUTS
    own = {port: name for port, name in outputs.items() if name.partition(":")[0] in systems}
    given = {*given, *(outputs.keys() - own.keys())}
    try:
        bends = scenario.camera.renderer != NO_CAMERA and any(scenario.camera.resolved().distortion)
        diagram = _wired(systems, inputs, own, rectify=bends, given=given)
    except RuntimeError as e:  # Drake's, on types, sizes and algebraic loops
        raise UserError(f"The systems do not fit together: {' '.join(str(e).split())}") from None
    diagram.set_name(part)
    return diagram


def _wired(
    systems: dict, inputs: tuple, outputs: dict, rectify: bool, given: Collection[str]
) -> Diagram:
    """Returns the diagram of the systems, joined by the names of their ports.

    Args:
        systems: by name.
        inputs: names of ports that come from the Simulation.
        outputs: name of a port to the name of the system that makes it; see LEARNED_OUTPUTS.
        rectify: whether the camera's pictures pass a Rectifier.
        given: names of ports that come from elsewhere, although they may be among the outputs.
    """
    builder = DiagramBuilder()
    for name, system in systems.items():
        builder.AddNamedSystem(name, system)
    sources = {}
    for port, name in outputs.items():
        system_name, _, own_name = name.partition(":")
        sources[port] = _output(systems[system_name], own_name or port)
    for name, port in sources.items():
        builder.ExportOutput(port, name)
    for name in given:
        sources.pop(name, None)
    exported = set()
    if rectify and any(system.HasInputPort(n) for system in systems.values() for n in _RECTIFIED):
        rectifier = builder.AddNamedSystem("rectifier", Rectifier())
        for name in _RECTIFIED:
            builder.ExportInput(rectifier.GetInputPort(name), name)
            sources[name] = rectifier.GetOutputPort(name)
    for system in systems.values():
        for i in range(system.num_input_ports()):
            port = system.get_input_port(i)
            name = port.get_name()
            if name in sources:
                builder.Connect(sources[name], port)
            elif name in exported:
                builder.ConnectInput(name, port)
            elif name in (*inputs, *given):
                builder.ExportInput(port, name)
                exported.add(name)
            else:
                raise UserError(
                    f"The system {system.get_name()} has an input port '{name}', which nothing "
                    f"provides; there are: {', '.join([*inputs, *outputs])}."
                )
    return builder.Build()


def make_system(name: str, scenario: Scenario) -> System:
    """Makes a system by its default or by the scenario's "module:callable"."""
    if name not in scenario.systems:
        return systems_of(scenario)[name](scenario)
    path = scenario.systems[name]
    module, _, attribute = path.partition(":")
    try:
        make = getattr(importlib.import_module(module), attribute)
    except Exception as e:  # whatever the module does when it is imported
        raise UserError(
            f"systems.{name}: '{path}' cannot be imported as module:callable "
            f"({_described(e)}); check its spelling and PYTHONPATH."
        ) from e
    try:
        system = make(scenario)
    except Exception as e:
        raise UserError(
            f"systems.{name}: {path} cannot be called with the scenario ({_described(e)})."
        ) from e
    if not isinstance(system, System):
        raise UserError(
            f"systems.{name}: {path} must return a System, not a {type(system).__name__}."
        )
    return system


def _described(error: Exception) -> str:
    """Returns what went wrong in a system's own code, and where, on one line."""
    message = " ".join(f"{type(error).__name__}: {error}".split())
    frame = traceback.extract_tb(error.__traceback__)[-1]
    if frame.filename == __file__ or "importlib" in frame.filename:
        return message
    return f"{message}, at {frame.filename}:{frame.lineno}"


def _output(system: System, port: str) -> OutputPort:
    if not system.HasOutputPort(port):
        raise UserError(f"The system {system.get_name()} must have an output port '{port}'.")
    return system.GetOutputPort(port)
