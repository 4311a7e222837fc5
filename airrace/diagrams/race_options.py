"""The options of a race on the command line, and the scenario that they make."""

import argparse
import functools
from pathlib import Path

from airrace.common.errors import UserError
from airrace.hitl.companion.options import add_ssh_options

LEVELS = range(5)  # of models/scenarios/levels.yaml
# Fields of the scenario that options give.
_FIELDS = {name: name for name in ("drone", "trajectory", "track", "laps", "seed", "map")} | {
    "limits": "planner.limits",
    "renderer": "camera.renderer",
    "record": "recording.content",
    "realtime_rate": "simulator_config.target_realtime_rate",
}

EPILOG = """\
examples:
  ./run.bash                           ten laps of the reference track
  ./run.bash --laps 2 -t 4             two laps, yaw along the gates' headings
  ./run.bash --track my_track.yaml     a track of your own
  ./run.bash -d StarOne                the octocopter
  ./run.bash --level 3                 noise, a drone not as in its file, wind
  ./run.bash --scenario_file races --scenario_name NoNoise
  ./run.bash --scenario_text '{laps: 3, explorer: {max_speed: 4.0}}'
  ./run.bash --scenario_file runs/NAME/scenario.yaml   a race of yours again

The results are in the output folder: race.json, map.json, map_statistics.json,
scenario.yaml, race.mcap (for Foxglove and airrace.analysis), report.html,
and race.html (a replay, with --meshcat).
Exit codes: 0 finished, 1 did not finish, 2 bad input.
"""


def make_parser() -> argparse.ArgumentParser:
    """Returns the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="airrace",
        description="Explore a race track from the drone's camera, map it, and race it.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    race = parser.add_argument_group("the race")
    add_drone_options(race)
    race.add_argument(
        "-s",
        "--simulation",
        choices=("SITL", "HITL"),
        default="SITL",
        help="where the autonomy runs: software or hardware in the loop "
        "(default: SITL, in this process)",
    )
    race.add_argument(
        "--companion",
        metavar="local|USER@HOST[:PORT]",
        default="local",
        help="HITL: where the autonomy runs; local = another process here; "
        "none = you start it yourself, see python -m airrace.diagrams.hitl --help "
        "(default: local)",
    )
    add_ssh_options(race)
    race.add_argument(
        "--lcm_url",
        metavar="URL",
        help="HITL: of LCM (default: udpm://239.255.76.67:7667?ttl=0, with a free port for "
        "--companion local, and ttl=1 for USER@HOST)",
    )
    race.add_argument(
        "--lockstep",
        action="store_true",
        help="HITL: tick by tick in the place of real time; the same race as SITL",
    )
    race.add_argument(
        "--track",
        metavar="NAME|FILE",
        help="a shipped track, or a YAML file (default: student-airrace)",
    )
    race.add_argument("--laps", type=int, metavar="N", help="laps after exploring (default: 10)")
    race.add_argument(
        "--seed",
        type=int,
        metavar="N",
        help="seed of all randomness; the same seed, the same race (default: 0)",
    )
    add_level_option(race)
    race.add_argument(
        "--renderer",
        choices=("planar", "vtk", "none"),
        help="what draws the camera's image (default: planar, which is fast); "
        "none = there is no camera, for races with --map",
    )
    race.add_argument(
        "--map",
        metavar="track|FILE",
        help="races on a map that is given, with neither exploration nor detection: track = "
        "where the gates are, or the map.json of an earlier race",
    )
    run = parser.add_argument_group("the run")
    run.add_argument(
        "--output",
        type=Path,
        metavar="DIR",
        help="where the results go, a folder without a race in it "
        "(default: runs/<UTC time>-<track>-<drone>-<t>)",
    )
    run.add_argument(
        "--meshcat",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="show the race in a browser and leave a replay (default: yes)",
    )
    run.add_argument(
        "--report",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="leave report.html, a page of pictures and tables (default: yes)",
    )
    run.add_argument(
        "--record",
        choices=("none", "light", "full"),
        help="what race.mcap holds: light = all signals, full = and pictures of the "
        "camera; it costs about a fifth of the race's time (default: full)",
    )
    run.add_argument(
        "--realtime_rate",
        type=float,
        metavar="R",
        help="1 = real time, 0 = as fast as it can (default: 0)",
    )
    run.add_argument(
        "--graphviz",
        type=Path,
        metavar="FILE",
        help="write the diagram in Graphviz's dot language before the race",
    )
    add_scenario_options(parser)
    return parser


def add_level_option(group, default="") -> None:
    """Adds --level to a group of a parser's; default: what its help ends with."""
    group.add_argument(
        "--level",
        type=int,
        choices=LEVELS,
        help="difficulty: 0 = no noise; 1 = noise and a realistic camera; 2 = and a "
        "drone not quite as its file says; 3 = and wind, and a harsh camera; "
        "4 = and gates that move between laps; short for --scenario_file levels "
        f"--scenario_name Level<N> {default}".rstrip(),
    )


def add_drone_options(group) -> None:
    """Adds the options of what is raced to a group of a parser's."""
    group.add_argument(
        "-d",
        "--drone",
        metavar="NAME|DIR",
        help="a shipped drone, Default or StarOne, or the folder of your own (default: Default)",
    )
    group.add_argument(
        "-t",
        "--trajectory",
        choices=("3", "4", "6", "optimal"),
        help="optimal = the quickest laps within the limits, anywhere through the "
        "gates; or minimum snap through their midpoints: 3 = of x, y, z; 4 = and "
        "yaw along the gates' headings; 6 = and roll = pitch = 0 at the gates "
        "(default: optimal)",
    )
    group.add_argument(
        "--limits",
        metavar="original|rotor|v=..,a=..",
        help="what laps keep to: original = 20 m/s and 10 m/s^2; rotor = nothing "
        "but what the rotors can do; or limits of your own in m/s and m/s^2, such "
        "as v=15,a=8 (default: original)",
    )


def add_scenario_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options that load_scenario() needs to a parser."""
    scenario = parser.add_argument_group(
        "the scenario", "Fields of airrace/scenario/scenario.py; options above win over them."
    )
    scenario.add_argument(
        "--scenario_file",
        metavar="NAME|FILE",
        help="YAML with one scenario a top-level key; 'races' and 'levels' are shipped",
    )
    scenario.add_argument(
        "--scenario_name", metavar="KEY", help="which scenario of the file (default: Defaults)"
    )
    scenario.add_argument(
        "--scenario_text", metavar="YAML", help="scenario fields on top, e.g. '{state_noise: none}'"
    )


def resolve_scenario(args):
    """Returns the checked Scenario that the command line asks for.

    Raises:
        UserError: naming the option or the field and the remedy.
    """
    from airrace.scenario import load_scenario

    filename, name = args.scenario_file, args.scenario_name
    if args.level is not None:
        if filename is not None or name is not None:
            raise UserError(
                "--level is a scenario of its own: leave out --scenario_file and "
                "--scenario_name, or --level."
            )
        filename, name = "levels", f"Level{args.level}"
    scenario = load_scenario(
        filename=filename, scenario_name=name, scenario_text=args.scenario_text
    )
    for option, field in _FIELDS.items():
        value = getattr(args, option, None)
        if value is not None:
            *groups, name = field.split(".")
            setattr(functools.reduce(getattr, groups, scenario), name, value)
    if args.simulation == "HITL":
        from airrace.diagrams.hitl_race import prepared

        scenario = prepared(scenario, args.lockstep)
    elif args.lockstep or args.lcm_url is not None:
        raise UserError("--lockstep and --lcm_url are for HITL: add -s HITL.")
    scenario.check()
    return scenario
