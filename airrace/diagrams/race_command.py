"""The command that races, with everything in one process."""

import contextlib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, Parameter

from airrace.common.command_line import Whole, typed_command
from airrace.common.errors import UserError, words
from airrace.common.interrupts import sigterm_as_ctrl_c
from airrace.scenario.options import RACE, RUN, DroneOptions, resolve_scenario

if TYPE_CHECKING:
    from airrace.diagrams.transport import Transport
    from airrace.scenario import Scenario

    # From the scenario, the folder of the results, and what shows a line.
    MakeTransport = Callable[
        [Scenario, Path, Callable[[str], object]], AbstractContextManager[Transport]
    ]

EPILOG = """\
examples:
  airrace race                           ten laps of the track student-airrace
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


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class RaceOptions(DroneOptions):
    """What a race may be told."""

    track: Annotated[str | None, Parameter(group=RACE, metavar="NAME|FILE")] = None
    "a shipped track, or a YAML file (default: student-airrace)"
    laps: Annotated[Whole | None, Parameter(group=RACE)] = None
    "laps to fly after exploring (default: 10)"
    seed: Annotated[Whole | None, Parameter(group=RACE)] = None
    "seed of all random numbers; the same seed gives the same race (default: 0)"
    renderer: Annotated[Literal["planar", "vtk", "none"] | None, Parameter(group=RACE)] = None
    (
        "what draws the camera's image: planar is fast, vtk is Drake's own; none = there is no "
        "camera, for races with --map (default: planar)"
    )
    map: Annotated[str | None, Parameter(group=RACE, metavar="track|FILE")] = None
    (
        "give the drone a map, so that it neither explores nor looks for gates: track = the true "
        "places of the gates; or the map.json of an earlier race"
    )
    output: Annotated[Path | None, Parameter(group=RUN, metavar="DIR")] = None
    (
        "where the results go: a new folder, or one without results "
        "(default: runs/<UTC time>-<track>-<drone>-<t>)"
    )
    meshcat: Annotated[bool, Parameter(group=RUN)] = True
    "show the race in a browser and leave a replay (default: yes)"
    linger: Annotated[float | None, Parameter(group=RUN, metavar="S")] = None
    (
        "how many seconds the page stays after the race while somebody watches it; 0 = not at all "
        "(default: until Ctrl-C, or until the page is closed)"
    )
    allow_origin: Annotated[
        tuple[str, ...], Parameter(group=RUN, metavar="ORIGIN", negative=())
    ] = ()
    "a proxy through which you open the page, such as https://hub.example.org; may be repeated"
    report: Annotated[bool, Parameter(group=RUN)] = True
    "leave report.html, a page of pictures and tables (default: yes)"
    record: Annotated[Literal["none", "light", "full"] | None, Parameter(group=RUN)] = None
    (
        "what race.mcap holds: light = all signals; full = also the camera's pictures, and then "
        "recording is about a fifth of the race's time (default: full)"
    )
    foxglove: Annotated[bool, Parameter(group=RUN, negative=())] = False
    "serve the topics of race.mcap while they are written, for Foxglove: ws://localhost:8765"
    realtime_rate: Annotated[float | None, Parameter(group=RUN)] = None
    "how fast to simulate: 1 = real time, 0 = as fast as possible (default: 0, in HITL 1)"
    graphviz: Annotated[Path | None, Parameter(group=RUN, metavar="FILE")] = None
    "write the diagram in Graphviz's dot language before the race"


def add_to(app: App) -> None:
    """Adds the subcommand to a command line."""
    app.command(race, help_epilogue=EPILOG)


@sigterm_as_ctrl_c()
def race(*, options: RaceOptions = RaceOptions()) -> int:
    """Explore a race track from the drone's camera, map it, and race it."""
    result, _ = fly(options)
    return 0 if result["finished"] else 1


def race_scenario(options: RaceOptions) -> "Scenario":
    """Returns the checked Scenario that options ask for.

    Raises:
        UserError: naming the option or the field and the remedy.
    """
    scenario = resolve_scenario(options)
    scenario.check()
    return scenario


def fly(
    options: RaceOptions,
    quiet: bool = False,
    *,
    scenario: "Scenario | None" = None,
    transport: "MakeTransport | None" = None,
) -> tuple[dict, Path]:
    """Flies a race and shows it on the terminal; returns race.json and its folder.

    Args:
        options: of the command line.
        quiet: whether to print nothing.
        scenario: checked; by default, what the options ask for.
        transport: where the autonomy is; by default, in this process.

    Raises:
        UserError: on bad input.
    """
    from rich.console import Console

    from airrace.common.files import EVALUATION, results_folder, run_path
    from airrace.diagrams.in_process import InProcess
    from airrace.diagrams.race import INTERRUPTED, RESULTS, run_race
    from airrace.diagrams.warm_up import compile_apart
    from airrace.recording.foxglove_server import FoxgloveServer
    from airrace.track import load_track
    from airrace.vehicle import load_vehicle
    from airrace.visualization import reach
    from airrace.visualization.live_page import LivePage
    from airrace.visualization.terminal import RaceDisplay

    scenario = scenario or race_scenario(options)
    track = load_track(scenario.track, markers=True)
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
        page: LivePage | None = None
        if options.meshcat:
            page = LivePage(track, options.report, options.allow_origin)
            pages.enter_context(page)
        foxglove = pages.enter_context(FoxgloveServer()) if options.foxglove else None
        compile_apart(scenario)  # after the cheap checks: it may take a minute
        with contextlib.ExitStack() as stack:
            addresses = reach.lines(page.url) if page else []
            addresses += [f"Foxglove finds it at {foxglove.url}"] if foxglove else []
            console = Console(quiet=True) if quiet else None
            display = RaceDisplay(scenario, track, addresses, console)
            stack.callback(display.close)
            if page is not None:
                page.note = display.note
            if options.report:
                stack.enter_context(report_after(output_dir, display.announce, display.note))
            joined: Transport = InProcess()
            if transport is not None:
                joined = stack.enter_context(transport(scenario, output_dir, display.note))
            result = run_race(
                scenario,
                output_dir,
                page=page,
                sinks=[display.take],
                transport=joined,
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
def report_after(
    folder: Path, announce: Callable[[str], object], note: Callable[[str], object]
) -> Iterator[None]:
    """Writes report.html after the block. If it cannot, that is a line: the race was flown.

    Args:
        folder: of the race.
        announce: called with what is being done.
        note: called with the line.
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
    try:
        write()
    except Exception as e:
        note(f"There is no report.html ({words(e)}); try {typed_command()} report {folder}.")
