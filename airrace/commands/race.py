"""airrace race: explore a track, map it, and race it."""

import contextlib
import dataclasses as dc
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, Parameter

from airrace.commands.options import HITL, RACE, RUN, DroneOptions, Whole, resolve_scenario
from airrace.commands.ssh_options import ssh_companions
from airrace.common.errors import UserError

if TYPE_CHECKING:
    from airrace.scenario import Scenario

EPILOG = """\
examples:
  airrace race                           ten laps of the reference track
  airrace race --laps 2 -t 4             two laps, yaw along the gates' headings
  airrace race --track my_track.yaml     a track of your own
  airrace race -d StarOne                the octocopter
  airrace race --level 3                 noise, a drone not as in its file, wind
  airrace race --scenario_file races --scenario_name NoNoise
  airrace race --scenario_text '{laps: 3, explorer: {max_speed: 4.0}}'
  airrace race --scenario_file runs/NAME/scenario.yaml   a race of yours again

The results are in the output folder: race.json, map.json, map_statistics.json,
scenario.yaml, race.mcap (for Foxglove and airrace tables), report.html,
and race.html (a replay, with --meshcat).
Exit codes: 0 finished, 1 did not finish, 2 bad input."""
MAVLINK = "MAVLINK"


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class RaceOptions(DroneOptions):
    """What a race may be told."""

    track: Annotated[str | None, Parameter(group=RACE, metavar="NAME|FILE")] = None
    "a shipped track, or a YAML file (default: student-airrace)"
    laps: Annotated[Whole | None, Parameter(group=RACE)] = None
    "laps after exploring (default: 10)"
    seed: Annotated[Whole | None, Parameter(group=RACE)] = None
    "seed of all randomness; the same seed, the same race (default: 0)"
    renderer: Annotated[Literal["planar", "vtk", "none"] | None, Parameter(group=RACE)] = None
    (
        "what draws the camera's image (default: planar, which is fast); none = there is no "
        "camera, for races with --map"
    )
    map: Annotated[str | None, Parameter(group=RACE, metavar="track|FILE")] = None
    (
        "races on a map that is given, with neither exploration nor detection: track = where the "
        "gates are, or the map.json of an earlier race"
    )
    output: Annotated[Path | None, Parameter(group=RUN, metavar="DIR")] = None
    (
        "where the results go, a folder without results in it "
        "(default: runs/<UTC time>-<track>-<drone>-<t>)"
    )
    meshcat: Annotated[bool, Parameter(group=RUN)] = True
    "show the race in a browser and leave a replay (default: yes)"
    linger: Annotated[float | None, Parameter(group=RUN, metavar="S")] = None
    (
        "how long the page stays after the race if somebody watches it, in seconds; 0 = not at all "
        "(default: until Ctrl-C, or until the page is closed)"
    )
    report: Annotated[bool, Parameter(group=RUN)] = True
    "leave report.html, a page of pictures and tables (default: yes)"
    record: Annotated[Literal["none", "light", "full"] | None, Parameter(group=RUN)] = None
    (
        "what race.mcap holds: light = all signals, full = and pictures of the camera; it costs "
        "about a fifth of the race's time (default: full)"
    )
    foxglove: Annotated[bool, Parameter(group=RUN, negative=())] = False
    "serve the topics of race.mcap while they are written, for Foxglove: ws://localhost:8765"
    realtime_rate: Annotated[float | None, Parameter(group=RUN)] = None
    "1 = real time, 0 = as fast as it can (default: 0, in HITL 1)"
    graphviz: Annotated[Path | None, Parameter(group=RUN, metavar="FILE")] = None
    "write the diagram in Graphviz's dot language before the race"
    simulation: Annotated[Literal["SITL", "HITL", "MAVLINK"], Parameter(alias="-s", group=HITL)] = (
        "SITL"
    )
    (
        "where the autonomy runs: software or hardware in the loop, or MAVLINK = a client of the "
        "AI Grand Prix flies, see airrace grand-prix --help (default: SITL, in this process)"
    )
    companion: Annotated[
        str | None, Parameter(group=HITL, metavar="local|none|USER@HOST[:PORT]")
    ] = None
    (
        "where the autonomy runs in HITL: local = another process here; none = you start it "
        "yourself, see airrace hitl --help (default: local)"
    )
    identity: Annotated[Path | None, Parameter(group=HITL, metavar="FILE")] = None
    "the private key for --companion USER@HOST (default: those that ssh would try)"
    wheels: Annotated[Path | None, Parameter(group=HITL, metavar="DIR")] = None
    (
        "for a companion without the internet, a folder with a wheel of every locked package; "
        "the documentation of a companion board says how to fill it"
    )
    lcm_url: Annotated[str | None, Parameter(group=HITL, metavar="URL")] = None
    (
        "of LCM (default: udpm://239.255.76.67:7667?ttl=0, with a free port for --companion local, "
        "and ttl=1 for USER@HOST)"
    )
    lockstep: Annotated[bool, Parameter(group=HITL, negative=())] = False
    "tick by tick in the place of real time; the same race as SITL"


def add_to(app: App) -> None:
    """Adds the subcommand to the command line."""
    app.command(race, help_epilogue=EPILOG)


def race(*, options: RaceOptions = RaceOptions()) -> int:
    """Explore a race track from the drone's camera, map it, and race it."""
    result, _ = fly(options)
    return 0 if result["finished"] else 1


def race_scenario(options: RaceOptions) -> "Scenario":
    """Returns the checked Scenario that options ask for.

    Raises:
        UserError: naming the option or the field and the remedy.
    """
    if options.simulation == MAVLINK:
        raise UserError("Races of a client have a command of their own: airrace grand-prix.")
    if options.simulation == "SITL":
        for name in ("companion", "lcm_url", "lockstep"):
            if getattr(options, name):
                raise UserError(f"--{name} is for hardware in the loop: add -s HITL.")
    scenario = resolve_scenario(options)
    if options.simulation == "HITL":
        from airrace.diagrams.hitl_race import prepared

        scenario = prepared(scenario, options.lockstep)
    scenario.check()
    return scenario


def fly(options: RaceOptions, quiet: bool = False) -> tuple[dict, Path]:
    """Flies a race and shows it on the terminal; returns race.json and its folder.

    Args:
        options: of the command line.
        quiet: whether to print nothing.

    Raises:
        UserError: on bad input.
    """
    from rich.console import Console

    from airrace.common.files import results_folder, run_path
    from airrace.diagrams.race import INTERRUPTED, RESULTS, run_race
    from airrace.diagrams.warm_up import compile_apart
    from airrace.evaluation.store import FILES as EVALUATION
    from airrace.recording.foxglove_server import FoxgloveServer
    from airrace.track import load_track
    from airrace.vehicle import load_vehicle
    from airrace.visualization.live_page import LivePage
    from airrace.visualization.terminal import RaceDisplay

    if options.simulation == "HITL" and options.companion is None:
        options = dc.replace(options, companion="local")
    scenario = race_scenario(options)
    make_companion = ssh_companions(options)
    track = load_track(scenario.track)
    vehicle, _ = load_vehicle(scenario.drone)
    if options.graphviz is not None:
        write_graphviz(options.graphviz, scenario)
    kind = f"{scenario.trajectory}d" if scenario.trajectory.isdigit() else scenario.trajectory
    folder = options.output or run_path(track.name, vehicle.name, kind)
    numbered = options.output is None
    with (
        contextlib.ExitStack() as pages,
        results_folder(folder, numbered=numbered, refuse=RESULTS + EVALUATION) as output_dir,
    ):
        page = pages.enter_context(LivePage(track, options.report)) if options.meshcat else None
        foxglove = pages.enter_context(FoxgloveServer()) if options.foxglove else None
        compile_apart(scenario)  # after the cheap checks: it may take a minute
        with contextlib.ExitStack() as stack:
            addresses = [f"Watch it at {page.url}"] if page else []
            addresses += [f"Foxglove finds it at {foxglove.url}"] if foxglove else []
            console = Console(quiet=True) if quiet else None
            display = RaceDisplay(scenario, track, addresses, console)
            stack.callback(display.close)
            if options.report:
                stack.enter_context(report_after(output_dir, display.announce))
            transport = None
            if options.simulation == "HITL":
                from airrace.diagrams.hitl_race import remote_transport

                transport = stack.enter_context(
                    remote_transport(options, scenario, output_dir, make_companion, display.note)
                )
            result = run_race(
                scenario,
                output_dir,
                page=page,
                sinks=[display.take],
                transport=transport,
                foxglove=foxglove,
            )
        display.print_summary(result, output_dir)
        if page is not None and result["dnf_reason"] != INTERRUPTED:
            page.linger(output_dir, options.linger, display.note)
    return result, output_dir


def write_graphviz(path: Path, scenario: "Scenario") -> None:
    """Writes the diagram of a race in Graphviz's dot language."""
    from airrace.diagrams.race import MakeRace

    try:
        path.write_text(MakeRace(scenario).GetGraphvizString(), encoding="utf-8")
    except OSError as e:
        raise UserError(
            f"--graphviz {path} cannot be written ({e.strerror}); name another file."
        ) from None


@contextlib.contextmanager
def report_after(folder: Path, announce: Callable[[str], None]) -> Iterator[None]:
    """Writes report.html after the block; if that raises, nothing else is raised.

    Args:
        folder: of the race.
        announce: called with what is being done.
    """

    def write():
        from airrace.analysis.report import write_report

        announce("Writing report.html")
        write_report(folder)

    try:
        yield
    except BaseException:
        with contextlib.suppress(Exception):
            write()
        raise
    write()
