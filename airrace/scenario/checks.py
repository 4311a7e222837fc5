"""What a scenario's values must be. All raise UserError with one sentence."""

import math
import re
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from airrace.common.errors import UserError
from airrace.scenario import imu_config
from airrace.scenario.camera_config import NO_CAMERA, PRESETS, RENDERERS, CameraConfig
from airrace.scenario.lap_limits import parse_limits
from airrace.scenario.mavlink_config import NONE, OFFICIAL, MavlinkConfig
from airrace.vehicle.disturbances import DisturbancesConfig, RotorFailure
from airrace.vehicle.sensor_failures import (
    CAMERA_FAILURES,
    IMU_FAILURES,
    RADIO_FAILURES,
    CameraFailure,
    ImuFailure,
)

if TYPE_CHECKING:
    from airrace.scenario import PlannerConfig, Scenario

# Least and greatest value of numbers for which "positive" does not say it all;
# [] is any element of a list. The upper limits keep a slip of the pen from
# filling the memory.
RANGES = {
    "laps": (1, 1000),
    "plant_config.time_step": (1e-6, 0.01),
    "seed": (0, 2**256),  # beyond 2^53, nobody can find it by trying: see math/random.py
    "camera.width": (16, 8192),
    "camera.height": (16, 8192),
    "camera.fov_y_deg": (1, 170),
    "camera.fps": (1, 1000),
    "camera.effects.shutter": (0, 1),
    "camera.effects.gain": (0.05, 10),
    "camera.effects.vignetting": (0, 1),
    "camera.effects.read_noise": (0, 50),
    "camera.effects.shot_noise": (0, 10),
    "camera.effects.latency": (0, 1),
    "camera.effects.distortion[]": (-10, 10),
    "imu.rate": (1, 10000),
    "imu.errors.gyro_noise": (0, 1),
    "imu.errors.gyro_bias": (0, 10),
    "imu.errors.gyro_walk": (0, 1),
    "imu.errors.accelerometer_noise": (0, 10),
    "imu.errors.accelerometer_bias": (0, 100),
    "imu.errors.accelerometer_walk": (0, 10),
    "imu.errors.scale": (0, 0.5),
    "imu.errors.axes": (0, 0.5),
    "imu.errors.latency": (0, 0.1),
    "imu.errors.time_offset": (-0.1, 0.1),
    "recording.state_rate": (1, 1000),
    "recording.pose_rate": (1, 1000),
    "recording.image_rate": (0.1, 1000),
    "recording.image_width": (16, 8192),
    "recording.jpeg_quality": (1, 100),
    "recording.flush_period": (0.01, 60),
    "rotors.rate": (1, 10000),
    "referee.rate": (1, 10000),
    "state_estimate.rate": (1, 10000),
    "state_estimate.position_sigma": (0, math.inf),
    "state_estimate.velocity_sigma": (0, math.inf),
    "disturbances.wind.mean[]": (-30, 30),
    "disturbances.wind.mean_speed": (0, 30),
    "disturbances.wind.gust_rms": (0, 20),
    "disturbances.drag": (0, 10),
    "disturbances.mass_error": (0, 0.5),
    "disturbances.inertia_error": (0, 0.5),
    "disturbances.thrust_coefficient_error": (0, 0.5),
    "disturbances.actuator_delay": (0, 0.1),
    "disturbances.gate_shift": (0, 2),
    "rotor_failures[].rotor": (1, math.inf),
    "rotor_failures[].time": (0, math.inf),
    "imu_failures[].time": (0, math.inf),
    "camera_failures[].time": (0, math.inf),
    "radio_failures[].time": (0, math.inf),
    "perception.max_gates": (1, 256),
    "perception.map_period": (0.001, 3600),
    "explorer.rate": (1, 10000),
    "explorer.step_length": (0.5, math.inf),
    "explorer.expected_gates": (3, 256),
    "link_delay": (0, 0.5),
    "planner.rate": (1, 10000),
    "planner.first_lap_move": (0, math.inf),
    "planner.first_lap_drag": (0, 1),
    "planner.thrust_share": (0.1, 1),
    "mavlink.vq": (1, 2),
    "mavlink.jpeg_quality": (1, 100),
    "mavlink.chunk_size": (64, 60000),
    "mavlink.quirks.imu_drop": (0, 0.9),
    "mavlink.quirks.lost_pictures": (0, 1),
    "mavlink.quirks.repeated_pictures": (0, 1),
    "mavlink.quirks.clock_offset": (-1e6, 1e6),
    "state_filter.rate": (1, 10000),
    "rotor_monitor.rate": (1, 10000),
    "controller.rate": (1, 10000),
}
# What Drake checks itself.
_DRAKES = ("simulator_config.", "plant_config.", "directives[", "visualization.")
# Limits that .inf takes away.
UNLIMITED = ("perception.max_range", "imu.errors.gyro_range", "imu.errors.accelerometer_range")


def check_numbers(scenario: "Scenario") -> None:
    """Checks that all numbers are finite or may be infinite, and ours within their ranges."""
    for name, value in _numbers(scenario):
        is_unlimited = name in UNLIMITED and value == math.inf
        if isinstance(value, float) and not math.isfinite(value) and not is_unlimited:
            kind = "a positive number" if name in UNLIMITED else "a finite number"
            raise UserError(f"{name} must be {kind}, not {value}.")
        if not name.startswith(_DRAKES):
            _check_range(name, value)


def _numbers(value, name=""):
    """Yields the dotted names and the values of all numbers in a config."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        yield name, value
    elif isinstance(value, (list, np.ndarray)):
        for i, item in enumerate(value):
            yield from _numbers(item, f"{name}[{i}]")
    elif not isinstance(value, (bool, str, dict, type(None))):
        drakes_fields = getattr(value, "__fields__", None)
        names = (
            [field.name for field in drakes_fields]
            if drakes_fields
            else getattr(value, "__dict__", ())
        )
        for each in names:
            yield from _numbers(getattr(value, each), f"{name}.{each}" if name else each)


def _check_range(name, value):
    key = re.sub(r"\[\d+\]", "[]", name)
    if key not in RANGES and value <= 0:
        raise UserError(f"{name} must be positive, not {value}.")
    low, high = RANGES.get(key, (0, math.inf))
    if value < low:
        raise UserError(f"{name} must be at least {low}, not {value}.")
    if value > high:
        raise UserError(f"{name} must be at most {high}, not {value}.")


def check_choice(name: str, value: str, choices: Iterable[str]) -> None:
    """Checks that a value is one of the choices."""
    if value not in choices:
        raise UserError(f"{name} must be one of {', '.join(choices)}, not '{value}'.")


def check_camera(config: CameraConfig) -> None:
    """Checks the names of renderer and preset, and that effects fit into a frame."""
    check_choice("camera.renderer", config.renderer, (*RENDERERS, NO_CAMERA))
    check_choice("camera.preset", config.preset, PRESETS)
    effects = config.resolved()
    if len(effects.distortion) != 5 or not all(map(math.isfinite, effects.distortion)):
        raise UserError(
            "camera.effects.distortion must be five finite numbers, [k1, k2, p1, p2, k3]."
        )
    for name in ("shutter", "latency"):
        if getattr(effects, name) >= 1.0 / config.fps:
            raise UserError(
                f"camera.effects.{name} must be shorter than one frame, 1 / camera.fps; "
                f"it is {getattr(effects, name)} s."
            )


def check_imu(config: imu_config.ImuConfig) -> None:
    """Checks the name of the preset."""
    check_choice("imu.preset", config.preset, imu_config.PRESETS)


def check_mavlink(config: MavlinkConfig) -> None:
    """Checks the name of the dialect."""
    check_choice("mavlink.dialect (--quirks)", config.dialect, (OFFICIAL, NONE))


def check_estimator(scenario: "Scenario") -> None:
    """Checks the estimator's name, and that a drone that has to see where it is can see."""
    check_choice("estimator", scenario.estimator, ("truth", "vio"))
    if scenario.estimator == "vio" and (scenario.map or scenario.camera.renderer == NO_CAMERA):
        what = "--map" if scenario.map else "--renderer none"
        raise UserError(
            f"The estimator 'vio' sees from pictures where the drone is, and makes its own map: "
            f"leave out {what}, or set --estimator truth."
        )


def check_flight_controller(scenario: "Scenario") -> None:
    """Checks the flight controller's name, and that what flies can command it."""
    board = scenario.flight_controller.startswith("msp:")
    if not board:
        choices = "internal", "betaflight", "msp:PLACE"
        check_choice("flight_controller", scenario.flight_controller, choices)
    for i, failure in enumerate(scenario.radio_failures):
        check_choice(f"radio_failures[{i}].kind", failure.kind, RADIO_FAILURES)
    check_choice("betaflight_mode", scenario.betaflight_mode, ("rates", "angle"))
    for name, unused, is_used in (
        ("radio_failures", [], scenario.flight_controller == "betaflight"),
        ("betaflight_mode", "rates", scenario.flight_controller == "betaflight"),
        ("betaflight_config", "", scenario.flight_controller != "internal"),
    ):
        if getattr(scenario, name) != unused and not is_used:
            raise UserError(f"{name} is for Betaflight: set flight_controller to betaflight.")
    if board and not scenario.betaflight_config:
        raise UserError(
            "What a board makes of its sticks is not known: save what its command line prints "
            "after `dump`, and name the file with --betaflight_config."
        )
    if scenario.flight_controller == "internal":
        return
    if scenario.policy != "none":
        raise UserError("A policy commands the rotors itself: set flight_controller to internal.")


def check_planner(config: "PlannerConfig", trajectory: str) -> None:
    """Checks limits and choices, and that those of minimum-snap laps are made for such."""
    parse_limits(config.limits)
    check_choice("planner.update", config.update, ("if_better", "always"))
    for name, usual, other in (
        ("lap", "periodic", "rest_to_rest"),
        ("time_allocation", "exact", "original"),
    ):
        value = getattr(config, name)
        check_choice(f"planner.{name}", value, (usual, other))
        if value == other and trajectory == "optimal":
            raise UserError(
                f"planner.{name} '{other}' is for minimum-snap laps: set trajectory (-t) to 3, 4 "
                f"or 6, or leave planner.{name} at '{usual}'."
            )


def check_policy(policy: str) -> None:
    """Checks that the policy is one of the two names, or looks like a file."""
    if policy not in ("none", "learned") and not policy.endswith(".npz"):
        raise UserError(
            f"policy (--policy) must be none, learned, or the .npz file of a network, "
            f"not '{policy}'."
        )


def check_disturbances(config: DisturbancesConfig) -> None:
    """Checks what the ranges of the numbers leave open."""
    wind = config.wind
    if len(wind.mean) != 3:
        raise UserError(
            f"disturbances.wind.mean needs three numbers, x, y and z, not {len(wind.mean)}."
        )
    if (any(wind.mean) or wind.mean_speed or wind.gust_rms) and not config.drag:
        raise UserError("disturbances.wind acts through drag: set disturbances.drag, e.g. to 1.")


def check_rotor_failures(failures: list[RotorFailure]) -> None:
    """Checks that no rotor fails twice; which there are, only the vehicle knows."""
    rotors = [failure.rotor for failure in failures]
    for rotor in rotors:
        if rotors.count(rotor) > 1:
            raise UserError(f"rotor_failures has rotor {rotor} twice; name each rotor once.")


def check_imu_failures(failures: list[ImuFailure], config: imu_config.ImuConfig) -> None:
    """Checks the kinds, and that what shows the end of its range has a range."""
    errors = config.resolved()
    for i, failure in enumerate(failures):
        check_choice(f"imu_failures[{i}].kind", failure.kind, IMU_FAILURES)
        limited = math.isfinite(errors.gyro_range + errors.accelerometer_range)
        if failure.kind == "saturated" and not limited:
            raise UserError(
                f"imu_failures[{i}].kind 'saturated' needs an IMU with ranges: set "
                "imu.errors.gyro_range and accelerometer_range, or another imu.preset."
            )


def check_camera_failures(failures: list[CameraFailure], config: CameraConfig) -> None:
    """Checks the kinds, and that there is a camera."""
    for i, failure in enumerate(failures):
        check_choice(f"camera_failures[{i}].kind", failure.kind, CAMERA_FAILURES)
    if failures and config.renderer == NO_CAMERA:
        raise UserError("camera_failures need a camera: camera.renderer is 'none'.")


def check_drakes_own(simulator_config: SimulatorConfig, plant_config: MultibodyPlantConfig) -> None:
    """Lets Drake check its own structs, and adds what a race needs of them."""
    rate = simulator_config.target_realtime_rate
    if rate < 0:
        raise UserError(f"target_realtime_rate (--realtime_rate) must be at least 0, not {rate}.")
    if simulator_config.start_time != 0:
        raise UserError("simulator_config.start_time must be 0: a race starts at time zero.")
    for name in ("max_step_size", "accuracy"):
        _check_range(f"simulator_config.{name}", getattr(simulator_config, name))
    _check_range("plant_config.time_step", plant_config.time_step)
    # The scene has no hydroelastic shapes, and the referee reads point contacts.
    check_choice(
        "plant_config.contact_model",
        plant_config.contact_model,
        ("point", "hydroelastic_with_fallback"),
    )
    name = "simulator_config"
    try:
        ApplySimulatorConfig(simulator_config, Simulator(ConstantVectorSource([0.0])))
        name = "plant_config"
        AddMultibodyPlant(plant_config, DiagramBuilder())
    except (RuntimeError, SystemExit) as e:  # Drake's assertions arrive as SystemExit
        raise UserError(f"Drake refuses {name}: {' '.join(str(e).split())}") from None
