"""Options that subcommands share, and the scenario that they make.

A field's type says what it takes, the text below it is its help.
"""

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Group, Parameter

from airrace.common.errors import UserError

if TYPE_CHECKING:
    from airrace.scenario import Scenario

RACE = Group("The race", sort_key=1)
RUN = Group("The run", sort_key=2)
SCENARIO = Group(
    "The scenario", help="Any field of a race; the options above win over it.", sort_key=4
)


# Fields of the scenario that options give.
_FIELDS = {
    name: name
    for name in (
        "drone",
        "trajectory",
        "track",
        "laps",
        "seed",
        "map",
        "estimator",
        "policy",
        "flight_controller",
        "betaflight_mode",
        "betaflight_config",
    )
} | {
    "limits": "planner.limits",
    "renderer": "camera.renderer",
    "record": "recording.content",
    "realtime_rate": "simulator_config.target_realtime_rate",
}


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ScenarioOptions:
    """What says which scenario is meant."""

    scenario_file: Annotated[str | None, Parameter(group=SCENARIO, metavar="NAME|FILE")] = None
    "a YAML file whose top-level keys are scenarios; 'races' and 'levels' are shipped"
    scenario_name: Annotated[str | None, Parameter(group=SCENARIO, metavar="KEY")] = None
    "which scenario of the file (default: Defaults)"
    scenario_text: Annotated[str | None, Parameter(group=SCENARIO, metavar="YAML")] = None
    "fields that differ from the scenario's, such as '{state_noise: none}'"


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class DroneOptions(ScenarioOptions):
    """What is raced."""

    drone: Annotated[str | None, Parameter(alias="-d", group=RACE, metavar="NAME|DIR")] = None
    "a shipped drone, Default or StarOne, or the folder of your own (default: Default)"
    trajectory: Annotated[
        Literal["3", "4", "6", "optimal"] | None, Parameter(alias="-t", group=RACE)
    ] = None
    (
        "how laps are planned: optimal = the quickest within the limits, anywhere through the "
        "gates; 3, 4, 6 = minimum snap through the midpoints of the gates, of x, y and z (3), also "
        "of the yaw, along the gates' headings (4), also with roll and pitch 0 at the gates (6) "
        "(default: optimal)"
    )
    limits: Annotated[str | None, Parameter(group=RACE, metavar="original|rotor|v=..,a=..")] = None
    (
        "limits of speed and acceleration: original = 20 m/s and 10 m/s^2; rotor = only what the "
        "rotors can do; or your own in m/s and m/s^2, such as v=15,a=8 (default: original)"
    )
    estimator: Annotated[Literal["truth", "vio"] | None, Parameter(group=RACE)] = None
    (
        "how the drone knows where it is: truth = the simulator tells it, with a little noise; "
        "vio = it estimates that from gyroscope, accelerometer, rotor speeds and camera "
        "(default: truth)"
    )
    policy: Annotated[str | None, Parameter(group=RACE, metavar="none|learned|FILE")] = None
    (
        "a network that flies the laps: none = there is none, and planned laps are flown; learned "
        "= the one that is shipped for the drone; or your own, an .npz file (default: none)"
    )
    level: Annotated[Literal[0, 1, 2, 3, 4] | None, Parameter(group=RACE)] = None
    (
        "how difficult the race is; each level adds to the one before: 0 = no noise; 1 = noise and "
        "a realistic camera; 2 = a drone that is not quite as its file says; 3 = drag, wind and a "
        "harsh camera; 4 = gates that move between laps. Short for --scenario_file levels "
        "--scenario_name Level<N>"
    )


def resolve_scenario(options: ScenarioOptions) -> "Scenario":
    """Returns the Scenario that options ask for; it is not checked.

    Args:
        options: with any of the fields of RaceOptions.

    Raises:
        UserError: naming the option or the field and the remedy.
    """
    from airrace.scenario import load_scenario

    filename, name = options.scenario_file, options.scenario_name
    level = getattr(options, "level", None)
    if level is not None:
        if filename is not None or name is not None:
            raise UserError(
                "--level is a scenario of its own: leave out --scenario_file and "
                "--scenario_name, or --level."
            )
        filename, name = "levels", f"Level{level}"
    scenario = load_scenario(
        filename=filename, scenario_name=name, scenario_text=options.scenario_text
    )
    for option, field in _FIELDS.items():
        value = getattr(options, option, None)
        if value is not None:
            *groups, name = field.split(".")
            setattr(functools.reduce(getattr, groups, scenario), name, value)
    return scenario
