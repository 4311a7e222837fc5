"""The scenario: everything that defines a race, as one YAML file."""

import dataclasses as dc
import os
from pathlib import Path

from pydrake.common.yaml import yaml_dump_typed
from pydrake.multibody.parsing import ModelDirective
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import SimulatorConfig

from airrace.common.errors import UserError
from airrace.common.plain_values import make_plain
from airrace.common.resources import find_yaml, load_yaml, models_path
from airrace.scenario.camera_config import NO_CAMERA, CameraConfig
from airrace.scenario.checks import (
    check_camera,
    check_camera_failures,
    check_choice,
    check_disturbances,
    check_drakes_own,
    check_estimator,
    check_flight_controller,
    check_imu,
    check_imu_failures,
    check_mavlink,
    check_numbers,
    check_planner,
    check_policy,
    check_rotor_failures,
)
from airrace.scenario.imu_config import ImuConfig
from airrace.scenario.mavlink_config import MavlinkConfig
from airrace.scenario.visualization_config import VisualizationConfig
from airrace.track.map_files import TRACK
from airrace.vehicle import DRONES, find_vehicle
from airrace.vehicle.disturbances import DisturbancesConfig, RotorFailure
from airrace.vehicle.sensor_failures import CameraFailure, ImuFailure, RadioFailure

TRAJECTORIES = ("3", "4", "6", "optimal")
CORNERS = ("refit", "opencv")  # of markers
POSES = ("gate", "marker")
MAP_ESTIMATORS = ("robust", "original")
ATTITUDE_ERRORS = ("reduced", "lee")
GAINS = ("vehicle", "original")
NO_POLICY, LEARNED = "none", "learned"  # what flies the laps besides the planner; or a file
# What drives the motors: the controller itself, or the firmware; or, after "msp:", a real board.
INTERNAL, BETAFLIGHT, MSP = "internal", "betaflight", "msp:"
TRUTH, VIO = "truth", "vio"  # what tells the drone where it is
CONTENTS = ("none", "light", "full")  # of a recording
LINK_DELAY = 0.2  # s, of Scenario.link_delay in HITL


def trajectory_name(trajectory: str) -> str:
    """Returns what one of TRAJECTORIES is called in a text: ``6-D``, ``optimal``."""
    return f"{trajectory}-D" if trajectory.isdigit() else trajectory


def laps_name(trajectory: str, limits: str) -> str:
    """Returns what laps are called in a text: ``6-D``, ``optimal within limits rotor``."""
    name = trajectory_name(trajectory)
    return name if limits == "original" else f"{name} within limits {limits}"


@dc.dataclass
class StateEstimateConfig:
    """The noise of `state_noise: nominal`, and the rate of the estimate."""

    rate: float = 200.0  # Hz
    position_sigma: float = 0.005  # m, on each coordinate
    velocity_sigma: float = 0.03  # of the factor 1 + N(0, sigma) on v_x, v_y


@dc.dataclass
class RotorsConfig:
    """The motor controllers."""

    rate: float = 500.0  # Hz, of the commands that they take up and of their reports


@dc.dataclass
class RefereeConfig:
    """When a race is over."""

    rate: float = 200.0  # Hz, of its checks; contacts between two checks count, too
    time_limit: float | None = None  # s; by default 600, and 120 a lap
    arena_margin: float = 60.0  # m beyond the outermost pylons, and upwards
    contacts_end: bool = True  # false: the drone may go on after it has touched something


@dc.dataclass
class PerceptionConfig:
    """From pixels to the map."""

    OLD_NAMES = {"estimator": "map_estimator"}

    latency: float = 0.010  # s, from an image to its detections
    corners: str = "refit"  # by edges fitted to the picture; or "opencv", as OpenCV refines them
    poses: str = "gate"  # of a gate's two markers as one body; or "marker", each alone by OpenCV
    jump_filter: bool = True  # refuses markers whose pose jumps, and pictures if the drone's does
    max_range: float = 30.0  # m, farther observations do not enter the map; .inf for no limit
    max_gates: int = 20  # the rule book's limit: higher IDs are out of range
    map_estimator: str = "robust"  # or "original", section III to the letter
    outlier_sigma: float = 3.0  # standard deviations, the rejection threshold of `original`
    min_observations: int = 5  # of both pylons, before a gate is in the map
    map_period: float = 2.0  # s, between two writes of map.json and map_statistics.json


@dc.dataclass
class ExplorerConfig:
    """Section IV of the paper."""

    rate: float = 20.0  # Hz
    max_speed: float = 8.0  # m/s
    max_acceleration: float = 6.0  # m/s^2
    max_level_error_deg: float = 15.0  # tilt on the pad that the calibration accepts
    max_heading_error_deg: float = 5.0  # off gate 1, that it does not turn away
    reached_distance: float = 1.0  # m, when a set-point counts as reached
    hover_time: float = 0.5  # s, of hovering before a search step
    hover_before_step: bool = False  # before every step; false = on without a stop if forward
    step_length: float = 15.0  # m, of one step forward
    side_distance: float = 20.0  # m, in front of a gate when stepping around
    side_offset: float = 5.0  # m, to the side, if straight in front did not help
    closing_range: float = 40.0  # m, how near gate 1 must be to close the loop
    expected_gates: int | None = None  # that end the search; null = only gate 1 seen again does
    approach_distance: float = 8.0  # m, before a gate, if the straight path is not free
    passing_distance: float = 5.0  # m, beyond a gate before the drone stops
    replan_distance: float = 0.3  # m, by which gates ahead move in the map


@dc.dataclass
class PlannerConfig:
    """Section V of the paper."""

    rate: float = 20.0  # Hz
    latency: float = 1.0  # s, declared: from the map to the plan in force
    limits: str = "original"  # or "rotor", or such as "v=15,a=8"; see scenario/lap_limits.py
    # Of the rotors' limits: the rest is for the controller; null = all, or the betaflight_share of
    # the drone's file.
    thrust_share: float | None = None
    first_lap_move: float = 1.0  # m, by which gates may have moved since they were explored
    # Of the drag in the drone's file, that the first lap on a given map counts with, within the
    # rotors' limits: half of it if there may be all or none.
    first_lap_drag: float = 0.0
    # Laps of -t 3, 4 and 6: without a stop, or "rest_to_rest", each from hover to hover, 0.5 m
    # beyond the midpoint of gate 1.
    lap: str = "periodic"
    # Of -t 3, 4 and 6: the quickest laps within the limits, or "original", which weighs snap
    # against time, as it did: -t 3 exceeds the limits a little, -t 6 flies as -t 4.
    time_allocation: str = "exact"
    waits: bool = True  # for a drone that falls behind its plan: that is flown more slowly then
    update: str = "if_better"  # or "always", each lap on a new plan even if it is slower


@dc.dataclass
class StateFilterConfig:
    """What smooths the state estimate for the controller and the mapper."""

    rate: float = 250.0  # Hz, of checks for new estimates; it predicts from them to any time
    enabled: bool = True  # false: the newest estimate is used as it is, and no disturbance known


@dc.dataclass
class RotorMonitorConfig:
    """What notices rotors that have stopped."""

    rate: float = 200.0  # Hz, of its checks


@dc.dataclass
class ControllerConfig:
    """The geometric controller."""

    rate: float = 500.0  # Hz
    feed_forward: bool = True  # of the reference's jerk, snap and rates of yaw
    disturbance_rejection: bool = True  # against wind and drag: integral action
    attitude_error: str = "reduced"  # the tilt before the yaw; or "lee", the paper's law as it is
    gains: str = "vehicle"  # or "original": those, of force and moment (original_gains)
    rotor_overdrive: bool = True  # commands overshoot, so that the rotors answer sooner


@dc.dataclass
class RecordingConfig:
    """What race.mcap holds. It costs time and space, and changes nothing in the race."""

    content: str = "full"  # or "light", without pictures; or "none", no race.mcap
    state_rate: float = 50.0  # Hz, of states, reference and rotors
    pose_rate: float = 30.0  # Hz, of the poses that a 3-D view moves things by
    image_rate: float = 5.0  # Hz, up to the camera's
    image_width: int = 640  # px, wider pictures are made smaller
    jpeg_quality: int = 75  # of the pictures
    flush_period: float = 0.5  # s, what a crash can cost


@dc.dataclass
class Scenario:
    """Defines a race. Unknown keys in YAML are errors.

    See hardware_sim in Drake's documentation for the idea.
    """

    OLD_NAMES = {"pilot": "policy"}

    # What is raced.
    track: str = "student-airrace"  # name of a shipped track, or a file
    drone: str = "Default"  # a shipped drone, or the folder of one
    laps: int = 10  # after exploring
    trajectory: str = "optimal"  # in time; or the dimensions of minimum-snap laps, 3, 4 or 6
    seed: int = 0  # of all that is drawn at random

    # The simulated world.
    simulator_config: SimulatorConfig = dc.field(
        default_factory=lambda: SimulatorConfig(target_realtime_rate=0.0)
    )
    plant_config: MultibodyPlantConfig = dc.field(
        default_factory=lambda: MultibodyPlantConfig(
            time_step=0.001,
            contact_model="point",
            discrete_contact_approximation="lagged",
            # Sampled ports would show the state of one step later to whatever
            # samples them at the time of a step.
            use_sampled_output_ports=False,
        )
    )
    # A map to race on without exploring or seeing: "track" for the truth, or the map.json of an
    # earlier race. Without one, it is made in flight.
    map: str = ""
    camera: CameraConfig = dc.field(default_factory=CameraConfig)
    imu: ImuConfig = dc.field(default_factory=ImuConfig)
    rotors: RotorsConfig = dc.field(default_factory=RotorsConfig)
    # Drake's model directives: other bodies in the world. Of the renderers, only vtk draws them.
    directives: list[ModelDirective] = dc.field(default_factory=list)
    state_noise: str = "nominal"  # or "none": the estimate is the truth
    state_estimate: StateEstimateConfig = dc.field(default_factory=StateEstimateConfig)
    disturbances: DisturbancesConfig = dc.field(default_factory=DisturbancesConfig)
    rotor_failures: list[RotorFailure] = dc.field(default_factory=list)
    imu_failures: list[ImuFailure] = dc.field(default_factory=list)
    camera_failures: list[CameraFailure] = dc.field(default_factory=list)
    radio_failures: list[RadioFailure] = dc.field(default_factory=list)  # of Betaflight's commands
    referee: RefereeConfig = dc.field(default_factory=RefereeConfig)

    # The autonomy.
    estimator: str = "truth"  # tells where it is; or "vio": nothing but IMU, rotors and camera
    perception: PerceptionConfig = dc.field(default_factory=PerceptionConfig)
    explorer: ExplorerConfig = dc.field(default_factory=ExplorerConfig)
    # Who flies the laps: "none", a lap that is optimised; "learned", the shipped network of the
    # drone; or the .npz file of one.
    policy: str = "none"
    planner: PlannerConfig = dc.field(default_factory=PlannerConfig)
    state_filter: StateFilterConfig = dc.field(default_factory=StateFilterConfig)
    rotor_monitor: RotorMonitorConfig = dc.field(default_factory=RotorMonitorConfig)
    controller: ControllerConfig = dc.field(default_factory=ControllerConfig)
    # What drives the motors: "internal", the controller itself; "betaflight", the firmware, which
    # the controller tells thrust and body rates; or "msp:PLACE": a real board is told them, too.
    flight_controller: str = INTERNAL
    betaflight_mode: str = "rates"  # or "angle": its sticks ask for angles of roll and pitch
    betaflight_config: str = ""  # file of the firmware's settings; by default, the drone's own
    # s, from a command or picture to its effect or use, that the systems allow for; HITL sets it.
    link_delay: float = 0.0
    # Your own systems: a name from diagrams/autonomy.py to "module:callable",
    # which is called with this scenario and returns a System.
    systems: dict[str, str] = dc.field(default_factory=dict)

    # What a client is told that flies in the place of the autonomy.
    mavlink: MavlinkConfig = dc.field(default_factory=MavlinkConfig)

    # How it is seen, and what is kept of it.
    visualization: VisualizationConfig | None = None  # Drake's own means, such as Meldis
    recording: RecordingConfig = dc.field(default_factory=RecordingConfig)

    @property
    def localizes(self) -> bool:
        """Whether the drone finds out itself where it is."""
        return self.estimator == VIO

    def check(self) -> None:
        """Raises UserError with one sentence on the first bad value.

        Numbers of numpy, floats that are whole and paths become what YAML would give.
        """
        make_plain(self)
        check_numbers(self)
        check_choice("trajectory", self.trajectory, TRAJECTORIES)
        check_planner(self.planner, self.trajectory)
        check_policy(self.policy)
        check_flight_controller(self)
        check_choice("state_noise", self.state_noise, ("nominal", "none"))
        if self.perception.latency >= 1.0 / self.camera.fps:
            raise UserError("perception.latency must be shorter than one frame, 1 / camera.fps.")
        check_camera(self.camera)
        check_imu(self.imu)
        check_mavlink(self.mavlink)
        if self.camera.renderer == NO_CAMERA and not self.map:
            raise UserError("camera.renderer 'none' needs a map to race on: see --map.")
        check_estimator(self)
        check_choice("recording.content", self.recording.content, CONTENTS)
        if self.recording.content == "full" and self.recording.image_rate > self.camera.fps:
            raise UserError(
                f"recording.image_rate must be at most camera.fps, {self.camera.fps:g} Hz, "
                f"not {self.recording.image_rate:g}."
            )
        if (self.explorer.expected_gates or 0) > self.perception.max_gates:
            raise UserError(
                f"explorer.expected_gates must be at most perception.max_gates, "
                f"{self.perception.max_gates}, not {self.explorer.expected_gates}."
            )
        check_choice("perception.corners", self.perception.corners, CORNERS)
        check_choice("perception.poses", self.perception.poses, POSES)
        check_choice("perception.map_estimator", self.perception.map_estimator, MAP_ESTIMATORS)
        check_choice("controller.attitude_error", self.controller.attitude_error, ATTITUDE_ERRORS)
        check_choice("controller.gains", self.controller.gains, GAINS)
        check_disturbances(self.disturbances)
        check_rotor_failures(self.rotor_failures)
        check_imu_failures(self.imu_failures, self.imu)
        check_camera_failures(self.camera_failures, self.camera)
        check_drakes_own(self.simulator_config, self.plant_config)


def load_scenario(
    *,
    filename: str | os.PathLike[str] | None = None,
    scenario_name: str | None = None,
    scenario_text: str | None = None,
) -> Scenario:
    """Loads a scenario; what is given last wins.

    Args:
        filename: name of a shipped scenario file, or a path; None for the
            defaults.
        scenario_name: which top-level key of the file to take; by default
            ``Defaults``.
        scenario_text: YAML of a Scenario on top of that.

    Raises:
        UserError: naming the file and what is wrong.
    """
    result = Scenario()
    if filename is not None:
        result = load_yaml(
            Scenario,
            filename=find_yaml("scenarios", filename),
            child_name=scenario_name or "Defaults",
            defaults=result,
        )
    elif scenario_name is not None:
        raise UserError("--scenario_name needs --scenario_file.")
    if scenario_text:
        result = load_yaml(Scenario, data=scenario_text, what="--scenario_text", defaults=result)
    return result


def scenario_yaml(scenario: Scenario, absolute: bool = True) -> str:
    """Returns a scenario file that gives the same race again.

    Args:
        scenario: of the race.
        absolute: so that it does from any folder.
    """
    if not absolute:
        return yaml_dump_typed(scenario, schema=Scenario, child_name="Defaults")
    track = find_yaml("tracks", scenario.track)
    if track.parent != models_path() / "tracks":
        scenario = dc.replace(scenario, track=str(track.resolve()))
    if scenario.map not in ("", TRACK):
        scenario = dc.replace(scenario, map=str(Path(scenario.map).resolve()))
    if scenario.policy not in (NO_POLICY, LEARNED):
        scenario = dc.replace(scenario, policy=str(Path(scenario.policy).resolve()))
    if scenario.betaflight_config:
        config = str(Path(scenario.betaflight_config).resolve())
        scenario = dc.replace(scenario, betaflight_config=config)
    if scenario.drone not in DRONES:
        folder = find_vehicle(scenario.drone).parent
        scenario = dc.replace(scenario, drone=str(folder.resolve()))
    return yaml_dump_typed(scenario, schema=Scenario, child_name="Defaults")
