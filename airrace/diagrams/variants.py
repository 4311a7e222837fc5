"""The variants of the autonomy: which systems there are, and who hears whom."""

import dataclasses as dc
import functools
from collections.abc import Callable, Mapping

from pydrake.systems.framework import System

from airrace.diagrams.estimators import make_gate_slam, make_strapdown_integrator
from airrace.diagrams.wiring import Port
from airrace.scenario import BETAFLIGHT, INTERNAL, NO_POLICY, TRUTH, VIO, Scenario
from airrace.systems.control.geometric_controller import GeometricController
from airrace.systems.control.rate_controller import RateController
from airrace.systems.estimation.air_learner import AirLearner
from airrace.systems.estimation.moment_observer import MomentObserver
from airrace.systems.estimation.rotor_learner import RotorLearner
from airrace.systems.estimation.state_filter import make_state_filter
from airrace.systems.exploring.explorer import Explorer
from airrace.systems.failsafe.rotor_monitor import RotorMonitor
from airrace.systems.mapping.gate_mapper import GateMapper
from airrace.systems.mapping.known_map import KnownMap, NoDetector
from airrace.systems.perception.aruco_detector import ArucoDetector
from airrace.systems.planning.lap_planner import LapPlanner
from airrace.systems.planning.path_governor import PathGovernor
from airrace.systems.planning.trajectory_tracker import TrajectoryTracker
from airrace.systems.policy.command_switch import CommandSwitch
from airrace.systems.policy.policy_controller import PolicyController

Make = Callable[[Scenario], System]


@dc.dataclass(frozen=True)
class Variant:
    """Systems of an autonomy, joined by names: what one makes, all others can hear."""

    #: Name of a system to what makes it, unless the scenario's `systems` says otherwise.
    systems: Mapping[str, Make]
    inputs: tuple[str, ...] = ()  #: names of what may come from the Simulation
    #: Name of what is made to the port that it comes from. All are outputs of the Autonomy, too.
    outputs: Mapping[str, Port] = dc.field(default_factory=dict)
    #: Input port to the name of what it gets, where that is not the port's own name.
    aliases: Mapping[Port, str] = dc.field(default_factory=dict)
    #: Names of what not every system of one's own makes, and others hear only where it is made.
    optional: frozenset[str] = frozenset()
    #: Names of the systems of the half that controls; all others are the navigator's.
    pilot: frozenset[str] = frozenset()

    def __or__(self, addition: "Variant") -> "Variant":
        """Returns the variant with an addition, whose entries win."""
        return Variant(
            {**self.systems, **addition.systems},
            (*self.inputs, *addition.inputs),
            {**self.outputs, **addition.outputs},
            {**self.aliases, **addition.aliases},
            self.optional | addition.optional,
            self.pilot | addition.pilot,
        )


def _made_by(system: str, *names: str) -> dict[str, Port]:
    """Returns outputs that a system makes, under the names of its ports."""
    return {name: Port(system, name) for name in names}


# What all have.
_COMMON = Variant(
    systems={
        "aruco_detector": ArucoDetector.from_scenario,
        "lap_planner": LapPlanner.from_scenario,
        "trajectory_tracker": lambda scenario: TrajectoryTracker(),
        "rotor_learner": RotorLearner.from_scenario,
        "air_learner": AirLearner.from_scenario,
        "path_governor": PathGovernor.from_scenario,
        "moment_observer": MomentObserver.from_scenario,
        "rotor_monitor": RotorMonitor.from_scenario,
        "geometric_controller": GeometricController.from_scenario,
    },
    inputs=(
        "camera_image",
        "camera_grey",
        "camera_view",
        "camera_image_time",
        "camera_info",
        "rotor_speeds",
        "rotor_status",
    ),
    outputs={
        **_made_by("geometric_controller", "rotor_speed_command", "negative_thrusts"),
        **_made_by("trajectory_tracker", "reference"),
        **_made_by("rotor_learner", "rotor_factors"),
        **_made_by("air_learner", "air"),
        **_made_by("path_governor", "path_clock"),
        **_made_by("moment_observer", "disturbance_moment"),
        **_made_by("rotor_monitor", "rotor_losses"),
        **_made_by("lap_planner", "lap_plan"),
        **_made_by("explorer", "exploration_reference", "explorer_status"),
        **_made_by("aruco_detector", "detections"),
    },
    optional=frozenset({"estimate_fault", "estimate_drift", "policy_status", "negative_thrusts"}),
    pilot=frozenset(
        {
            "rotor_learner",
            "air_learner",
            "path_governor",
            "trajectory_tracker",
            "moment_observer",
            "rotor_monitor",
            "geometric_controller",
        }
    ),
)
# The simulator tells the drone where it is, with a little noise.
_TRUTH = _COMMON | Variant(
    systems={
        "gate_mapper": GateMapper.from_scenario,
        "explorer": Explorer.from_scenario,
        "state_filter": make_state_filter,
    },
    inputs=("state_estimate",),
    outputs={
        **_made_by("state_filter", "filtered_estimate", "disturbance"),
        **_made_by("gate_mapper", "gate_map"),
    },
    pilot=frozenset({"state_filter"}),
)
# The drone finds out itself where it is, from IMU, rotor speeds and pictures.
_VIO = _COMMON | Variant(
    systems={
        "gate_slam": make_gate_slam,
        "explorer": functools.partial(Explorer.from_scenario, drifts=True),
        "strapdown_integrator": make_strapdown_integrator,
    },
    inputs=("imu",),
    outputs={
        **_made_by("strapdown_integrator", "state_estimate", "filtered_estimate", "disturbance"),
        **_made_by("strapdown_integrator", "imu_history", "imu_silence"),
        **_made_by("gate_slam", "gate_map", "corrections", "slam_state"),
        **_made_by("gate_slam", "estimate_fault", "estimate_drift"),
    },
    pilot=frozenset({"strapdown_integrator"}),
)
# Added where a network flies the laps: both controllers command rotors, and the switch says whom
# these hear.
_LEARNED = Variant(
    systems={
        "policy_controller": PolicyController.from_scenario,
        "rate_controller": RateController.from_scenario,
        "command_switch": CommandSwitch.from_scenario,
    },
    outputs={
        **_made_by("command_switch", "rotor_speed_command"),
        "planned_command": Port("geometric_controller", "rotor_speed_command"),
        "policy_command": Port("rate_controller", "rotor_speed_command"),
        **_made_by("policy_controller", "rate_command", "policy_flies", "safe_reference"),
        **_made_by("policy_controller", "policy_status"),
    },
    aliases={
        Port("trajectory_tracker", "exploration_reference"): "safe_reference",
        Port("lap_planner", "exploration_reference"): "safe_reference",
    },
    pilot=frozenset({"policy_controller", "rate_controller", "command_switch"}),
)
# Added where the map is given.
_KNOWN_MAP = Variant(
    systems={"aruco_detector": lambda scenario: NoDetector(), "gate_mapper": KnownMap.from_scenario}
)
# Where a flight controller turns thrust and rates into what the motors get.
_COMMANDS = "rotor_speed_command"
_RATES = _made_by("geometric_controller", "rate_command")
ESTIMATORS = {TRUTH: _TRUTH, VIO: _VIO}
# Of every system that a scenario may name one of its own for.
SYSTEM_NAMES = tuple({**_TRUTH.systems, **_VIO.systems, **_LEARNED.systems})


def variant_of(scenario: Scenario) -> Variant:
    """Returns the variant that a scenario asks for."""
    variant = ESTIMATORS[scenario.estimator]
    if scenario.map:
        variant |= _KNOWN_MAP
    if scenario.policy != NO_POLICY:
        variant |= _LEARNED
    if scenario.flight_controller == INTERNAL:
        return variant
    outputs = {**variant.outputs, **_RATES}
    if scenario.flight_controller == BETAFLIGHT:
        del outputs[_COMMANDS]
    return dc.replace(variant, outputs=outputs)
