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
    "YAML with one scenario a top-level key; 'races' and 'levels' are shipped"
    scenario_name: Annotated[str | None, Parameter(group=SCENARIO, metavar="KEY")] = None
    "which scenario of the file (default: Defaults)"
    scenario_text: Annotated[str | None, Parameter(group=SCENARIO, metavar="YAML")] = None
    "scenario fields on top, e.g. '{state_noise: none}'"


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
        "optimal = the quickest laps within the limits, anywhere through the gates; or minimum "
        "snap through their midpoints: 3 = of x, y, z; 4 = and yaw along the gates' headings; 6 = "
        "and roll = pitch = 0 at the gates (default: optimal)"
    )
    limits: Annotated[str | None, Parameter(group=RACE, metavar="original|rotor|v=..,a=..")] = None
    (
        "what laps keep to: original = 20 m/s and 10 m/s^2; rotor = nothing but what the rotors "
        "can do; or limits of your own in m/s and m/s^2, such as v=15,a=8 (default: original)"
    )
    estimator: Annotated[Literal["truth", "vio"] | None, Parameter(group=RACE)] = None
    (
        "what tells the drone where it is: truth = the simulator, with a little noise; vio = "
        "nothing but gyroscope, accelerometer, rotor speeds and the camera (default: truth)"
    )
    policy: Annotated[str | None, Parameter(group=RACE, metavar="none|learned|FILE")] = None
    (
        "a network that flies the laps: none = an optimised lap is flown; learned = the one that "
        "is shipped for the drone; or the .npz file of your own (default: none)"
    )
    level: Annotated[Literal[0, 1, 2, 3, 4] | None, Parameter(group=RACE)] = None
    (
        "difficulty: 0 = no noise; 1 = noise and a realistic camera; 2 = and a drone not quite as "
        "its file says; 3 = and wind, and a harsh camera; 4 = and gates that move between laps; "
        "short for --scenario_file levels --scenario_name Level<N>"
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
