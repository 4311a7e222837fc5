"""The scenario: everything that defines a race, as one YAML file."""

import dataclasses as dc
import math
import typing

from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import SimulatorConfig

from airrace.errors import UserError
from airrace.resources import find_yaml, load_yaml

TRAJECTORIES = ("3", "4", "6")
RENDERERS = ("planar", "vtk")


@dc.dataclass
class CameraConfig:
    """The drone's camera."""

    renderer: str = "planar"  # or "vtk"
    width: int = 1280
    height: int = 720
    fov_y_deg: float = 55.95
    fps: float = 30.0


@dc.dataclass
class StateEstimateConfig:
    """The noise of `state_noise: reference`, and the rate of the estimate."""

    rate: float = 200.0  # Hz
    position_sigma: float = 0.005  # m, on each coordinate
    velocity_sigma: float = 0.03  # of the factor 1 + N(0, sigma) on v_x, v_y


@dc.dataclass
class RefereeConfig:
    """When a race is over."""

    time_limit: float = 1200.0  # s, exploration and laps
    arena_margin: float = 60.0  # m beyond the outermost pylons, and upwards


@dc.dataclass
class PerceptionConfig:
    """From pixels to the map."""

    latency: float = 0.010  # s, from exposure to detections
    max_range: float = 30.0  # m, farther sightings do not enter the map
    max_gates: int = 20  # the rule book's limit: higher IDs are out of range
    outlier_sigma: float = 3.0  # the report's rejection threshold
    min_sightings: int = 5  # before anything can be an outlier, or a gate


@dc.dataclass
class ExplorerConfig:
    """Section IV of the report."""

    rate: float = 20.0  # Hz
    max_speed: float = 8.0  # m/s
    max_acceleration: float = 6.0  # m/s^2
    reached_distance: float = 1.0  # m, when a set-point counts as reached
    hover_time: float = 0.5  # s, of looking before a search step
    step_length: float = 15.0  # m, of one step forward
    side_distance: float = 20.0  # m, in front of a lone marker when stepping around
    side_offset: float = 5.0  # m, to its side
    closing_range: float = 40.0  # m, how near gate 1 must be to close the loop
    passing_distance: float = 5.0  # m, beyond a gate before the drone stops
    max_level_error_deg: float = 15.0  # tilt on the pad that the calibration accepts


@dc.dataclass
class PlannerConfig:
    """Section V of the report."""

    rate: float = 20.0  # Hz
    latency: float = 0.5  # s, declared: from the map to the plan in force
    max_speed: float = 20.0  # m/s
    max_acceleration: float = 10.0  # m/s^2


@dc.dataclass
class ControllerConfig:
    """The geometric controller."""

    rate: float = 500.0  # Hz


@dc.dataclass
class Scenario:
    """Defines a race. Unknown keys in YAML are errors.

    See hardware_sim in Drake's documentation for the idea.
    """

    # What is raced.
    track: str = "student-airrace"  # name of a shipped track, or a file
    drone: str = "Default"
    laps: int = 10
    trajectory: str = "6"  # dimensions of the lap planner: 3, 4 or 6
    seed: int = 0

    # The simulated world.
    simulator_config: SimulatorConfig = dc.field(
        default_factory=lambda: SimulatorConfig(target_realtime_rate=0.0)
    )
    plant_config: MultibodyPlantConfig = dc.field(
        default_factory=lambda: MultibodyPlantConfig(
            time_step=0.001, contact_model="point", discrete_contact_approximation="lagged"
        )
    )
    camera: CameraConfig = dc.field(default_factory=CameraConfig)
    state_noise: str = "reference"  # or "none"
    state_estimate: StateEstimateConfig = dc.field(default_factory=StateEstimateConfig)
    referee: RefereeConfig = dc.field(default_factory=RefereeConfig)

    # The autonomy.
    perception: PerceptionConfig = dc.field(default_factory=PerceptionConfig)
    explorer: ExplorerConfig = dc.field(default_factory=ExplorerConfig)
    planner: PlannerConfig = dc.field(default_factory=PlannerConfig)
    controller: ControllerConfig = dc.field(default_factory=ControllerConfig)
    # Your own boxes: a name from diagrams/autonomy.py to "module:callable",
    # which is called with this scenario and returns a System.
    boxes: typing.Dict[str, str] = dc.field(default_factory=dict)

    def check(self) -> None:
        """Raises UserError with one sentence on the first bad value."""
        _check_numbers(self, "")
        _check_choice("trajectory", self.trajectory, TRAJECTORIES)
        _check_choice("camera.renderer", self.camera.renderer, RENDERERS)
        _check_choice("state_noise", self.state_noise, ("reference", "none"))
        _check_at_least("laps", self.laps, 1)
        _check_at_least("seed", self.seed, 0)
        _check_at_least(
            "simulator_config.target_realtime_rate", self.simulator_config.target_realtime_rate, 0
        )
        zero_allowed = ("position_sigma", "velocity_sigma")
        for section in ("camera", "state_estimate", "referee", "perception", "explorer",
                        "planner", "controller"):
            for name, value in vars(getattr(self, section)).items():
                if isinstance(value, (int, float)) and (
                    value < 0 or (value == 0 and name not in zero_allowed)
                ):
                    raise UserError(f"{section}.{name} must be positive, not {value}.")
        if not 0 < self.plant_config.time_step <= 0.01:
            raise UserError("plant_config.time_step must be above 0 and at most 0.01 s.")
        if self.camera.fov_y_deg >= 170:
            raise UserError("camera.fov_y_deg must be below 170.")
        if self.perception.latency >= 1.0 / self.camera.fps:
            raise UserError("perception.latency must be shorter than one frame, 1 / camera.fps.")


def _check_numbers(config, prefix):
    for name, value in vars(config).items():
        if dc.is_dataclass(value):
            _check_numbers(value, f"{prefix}{name}.")
        elif isinstance(value, float) and not math.isfinite(value):
            raise UserError(f"{prefix}{name} must be a finite number, not {value}.")


def _check_choice(name, value, choices):
    if value not in choices:
        raise UserError(f"{name} must be one of {', '.join(choices)}, not '{value}'.")


def _check_at_least(name, value, minimum):
    if value < minimum:
        raise UserError(f"{name} must be at least {minimum}, not {value}.")


def load_scenario(*, filename=None, scenario_name=None, scenario_text=None) -> Scenario:
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
        result = load_yaml(Scenario, data=scenario_text, defaults=result)
    return result
