"""airrace race: the race of diagrams/race/, and where its autonomy runs."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from airrace.common.errors import UserError
from airrace.common.interrupts import sigterm_as_ctrl_c
from airrace.diagrams.race_command import EPILOG, fly, race_scenario
from airrace.hitl.command import LINK, HitlOptions, fly_hitl
from airrace.scenario import INTERNAL, MSP
from airrace.scenario.options import RACE

MAVLINK = "MAVLINK"


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class AnyRaceOptions(HitlOptions):
    """What a race may be told, wherever its autonomy runs."""

    simulation: Annotated[Literal["SITL", "HITL", "MAVLINK"], Parameter(alias="-s", group=LINK)] = (
        "SITL"
    )
    (
        "where the autonomy runs: software or hardware in the loop, or MAVLINK = a client of the "
        "AI Grand Prix flies, see airrace grand-prix --help (default: SITL, in this process)"
    )
    flight_controller: Annotated[
        Literal["internal", "betaflight"] | None, Parameter(group=RACE)
    ] = None
    (
        "what drives the motors: internal = the controller itself; betaflight = the firmware that "
        "racing drones fly, see airrace betaflight --help (default: internal)"
    )
    betaflight_mode: Annotated[Literal["rates", "angle"] | None, Parameter(group=RACE)] = None
    (
        "what the firmware's sticks ask for: rates of roll and pitch, or angles, as in its angle "
        "mode (default: rates)"
    )
    betaflight_config: Annotated[str | None, Parameter(group=RACE, metavar="FILE")] = None
    (
        "the firmware's settings, lines of its command line, such as its `diff all` "
        "(default: the drone's betaflight.txt)"
    )


def add_to(app: App) -> None:
    """Adds the subcommand to the command line."""
    app.command(race, help_epilogue=EPILOG)


@sigterm_as_ctrl_c()
def race(*, options: AnyRaceOptions = AnyRaceOptions()) -> int:
    """Explore a race track from the drone's camera, map it, and race it."""
    result, _ = fly_any(options)
    return 0 if result["finished"] else 1


def fly_any(options: AnyRaceOptions, quiet: bool = False) -> tuple[dict, Path]:
    """Flies a race and shows it on the terminal; returns race.json and its folder.

    Args:
        options: of the command line.
        quiet: whether to print nothing.

    Raises:
        UserError: on bad input.
    """
    if options.simulation == MAVLINK:
        raise UserError("Races of a client have a command of their own: airrace grand-prix.")
    if options.simulation == "HITL":
        return fly_hitl(options, quiet)
    for name in ("companion", "identity", "wheels", "lcm_url", "link_key", "lockstep"):
        if getattr(options, name):
            raise UserError(f"--{name} is for hardware in the loop: add -s HITL.")
    scenario = race_scenario(options)
    if scenario.flight_controller.startswith(MSP):
        raise UserError(
            "A board is commanded by an autonomy that a person starts beside it: airrace hitl "
            f"autonomy --flight_controller {scenario.flight_controller}."
        )
    if scenario.flight_controller == INTERNAL:
        return fly(options, quiet, scenario=scenario)
    from airrace.betaflight.firmware import find_firmware
    from airrace.betaflight.settings import lines_of
    from airrace.betaflight.transport import find_settings, join_betaflight

    find_firmware()  # before anything that takes a while
    lines_of(find_settings(scenario))
    return fly(options, quiet, scenario=scenario, transport=join_betaflight)
