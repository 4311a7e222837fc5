"""The scenario: everything that defines a race, as one YAML file."""

import dataclasses as dc
import math
import typing

from pydrake.common.yaml import yaml_dump_typed
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from airrace.errors import UserError
from airrace.resources import find_yaml, load_yaml, models_path

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

    time_limit: typing.Optional[float] = None  # s; by default 600, and 120 a lap
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
            time_step=0.001, contact_model="point", discrete_contact_approximation="lagged",
            # Sampled ports would show the state of one step later to whatever
            # samples them at the time of a step.
            use_sampled_output_ports=False,
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
        for name, value in _numbers(self):
            if isinstance(value, float) and not math.isfinite(value):
                raise UserError(f"{name} must be a finite number, not {value}.")
            if not name.startswith(("simulator_config.", "plant_config.")):
                _check_range(name, value)
        _check_choice("trajectory", self.trajectory, TRAJECTORIES)
        _check_choice("camera.renderer", self.camera.renderer, RENDERERS)
        _check_choice("state_noise", self.state_noise, ("reference", "none"))
        if self.perception.latency >= 1.0 / self.camera.fps:
            raise UserError("perception.latency must be shorter than one frame, 1 / camera.fps.")
        _check_drakes_own(self.simulator_config, self.plant_config)


# Least and greatest value of numbers for which "positive" does not say it all.
# The upper limits keep a slip of the pen from filling the memory.
_RANGES = {
    "laps": (1, 1000),
    "seed": (0, math.inf),
    "camera.width": (16, 8192),
    "camera.height": (16, 8192),
    "camera.fov_y_deg": (1, 170),
    "camera.fps": (1, 1000),
    "state_estimate.rate": (1, 10000),
    "state_estimate.position_sigma": (0, math.inf),
    "state_estimate.velocity_sigma": (0, math.inf),
    "perception.max_gates": (1, 256),
    "explorer.rate": (1, 10000),
    "planner.rate": (1, 10000),
    "controller.rate": (1, 10000),
}


def _numbers(config, prefix=""):
    """Yields the dotted names and the values of all numbers in a config."""
    drakes_fields = getattr(config, "__fields__", None)
    names = [field.name for field in drakes_fields] if drakes_fields else vars(config)
    for name in names:
        value = getattr(config, name)
        if isinstance(value, (int, float)):
            yield prefix + name, value
        elif not isinstance(value, (str, dict, type(None))):
            yield from _numbers(value, f"{prefix}{name}.")


def _check_range(name, value):
    if name not in _RANGES and value <= 0:
        raise UserError(f"{name} must be positive, not {value}.")
    low, high = _RANGES.get(name, (0, math.inf))
    if value < low:
        raise UserError(f"{name} must be at least {low}, not {value}.")
    if value > high:
        raise UserError(f"{name} must be at most {high}, not {value}.")


def _check_choice(name, value, choices):
    if value not in choices:
        raise UserError(f"{name} must be one of {', '.join(choices)}, not '{value}'.")


def _check_drakes_own(simulator_config, plant_config):
    """Lets Drake check its own structs, and adds what a race needs of them."""
    rate = simulator_config.target_realtime_rate
    if rate < 0:
        raise UserError(f"target_realtime_rate (--realtime_rate) must be at least 0, not {rate}.")
    if simulator_config.start_time != 0:
        raise UserError("simulator_config.start_time must be 0: a race starts at time zero.")
    for name in ("max_step_size", "accuracy"):
        _check_range(f"simulator_config.{name}", getattr(simulator_config, name))
    if not 0 < plant_config.time_step <= 0.01:
        raise UserError("plant_config.time_step must be above 0 and at most 0.01 s.")
    # The scene has no hydroelastic shapes, and the referee reads point contacts.
    _check_choice("plant_config.contact_model", plant_config.contact_model,
                  ("point", "hydroelastic_with_fallback"))
    name = "simulator_config"
    try:
        ApplySimulatorConfig(simulator_config, Simulator(ConstantVectorSource([0.0])))
        name = "plant_config"
        AddMultibodyPlant(plant_config, DiagramBuilder())
    except (RuntimeError, SystemExit) as e:  # Drake's assertions arrive as SystemExit
        raise UserError(f"Drake refuses {name}: {' '.join(str(e).split())}") from None


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
        result = load_yaml(
            Scenario, data=scenario_text, what="--scenario_text", defaults=result
        )
    return result


def scenario_yaml(scenario: Scenario) -> str:
    """Returns a scenario file that gives the same race again, from any folder."""
    track = find_yaml("tracks", scenario.track)
    if track.parent != models_path() / "tracks":
        scenario = dc.replace(scenario, track=str(track.resolve()))
    return yaml_dump_typed(scenario, schema=Scenario, child_name="Defaults")
