"""airrace grand-prix: fly against the interface of the AI Grand Prix."""

import contextlib
import dataclasses as dc
import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import App, Group, Parameter

from airrace.common.command_line import Whole
from airrace.common.errors import UserError
from airrace.common.interrupts import sigterm_as_ctrl_c
from airrace.scenario.options import RACE, RUN, ScenarioOptions, resolve_scenario

if TYPE_CHECKING:
    from airrace.mavlink.client_link import Addresses
    from airrace.mavlink.dialects import Dialect
    from airrace.recording.race_events import Sink
    from airrace.scenario import Scenario

EPILOG = """\
Start it, and then a client that waits for MAVLink at 127.0.0.1:14550 and for pictures
at port 5600, as for the official simulator.
examples/grand_prix_client.py is one that finds the gates in the pictures.

examples:
  airrace grand-prix                          a course of 17 gates, in real time
  airrace grand-prix --vq 1                   and the client is told pose and gates
  airrace grand-prix --realtime_rate 0.5      for a slow client
  airrace grand-prix --step                   as fast as the client, and repeatable
  airrace track --kind square --seed 7 > seven.yaml
  airrace grand-prix --track seven.yaml --runs 0    race after race, until Ctrl-C
  airrace grand-prix --course official-like   17 gates, as in the second qualifier
  airrace grand-prix --quirks none            clean NED and FRD, for MAVSDK

--step waits for exactly one command, which is a set-point, arm or reset, after every
HIGHRES_IMU. A client that sends none for two seconds is not waited for until it sends
again; one that sends more flies, but not the same twice.

./run.bash -s MAVLINK is the same command.
The results are in the output folder: race.json, scenario.yaml, race.mcap, race.html with
--meshcat, race.tlog with --tlog; `airrace report` shows how a gate was missed. MAVLink
neither authenticates nor encrypts: without --bind, nobody but this computer is heard.
Exit codes: 0 finished, 1 did not finish, 2 bad input."""
CLIENT = Group("The client", sort_key=2)
SCENARIO_FILE = "grand_prix"
RESULTS = ("scenario.yaml", "race.json", "race.mcap", "race.html", "race.tlog")
# The courses of --course official-like, by the virtual qualifier.
_COURSES = {1: "grand-prix-straight", 2: "grand-prix"}


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class GrandPrixOptions(ScenarioOptions):
    """What a race of a client may be told."""

    track: Annotated[str | None, Parameter(group=RACE, metavar="NAME|FILE")] = None
    "a course of square gates (default: grand-prix)"
    drone: Annotated[str | None, Parameter(alias="-d", group=RACE, metavar="NAME|DIR")] = None
    "a drone of four rotors (default: vadr)"
    seed: Annotated[Whole | None, Parameter(group=RACE)] = None
    "seed of all randomness (default: 0)"
    renderer: Annotated[Literal["planar", "vtk"] | None, Parameter(group=RACE)] = None
    "what draws the camera's image (default: planar, which is fast)"
    vq: Annotated[Literal[1, 2] | None, Parameter(group=RACE)] = None
    ("virtual qualifier: 1 = pose and places of the gates are sent; 2 = they are not (default: 2)")
    course: Annotated[Literal["official-like"] | None, Parameter(group=RACE)] = None
    "a track like that of the virtual qualifier --vq, in place of --track"
    quirks: Annotated[Literal["official", "none"] | None, Parameter(group=RACE)] = None
    (
        "signs, clocks and race flow on the wire: official = as its clients know them, none = "
        "clean NED and FRD, for MAVSDK and whoever knows PX4 (default: official)"
    )
    client: Annotated[str, Parameter(group=CLIENT, metavar="HOST:PORT")] = "127.0.0.1:14550"
    "where the client waits for MAVLink (default: 127.0.0.1:14550)"
    picture_port: Annotated[Whole, Parameter(group=CLIENT)] = 5600
    "the client's port of pictures (default: 5600)"
    bind: Annotated[str, Parameter(group=CLIENT, metavar="ADDRESS")] = "127.0.0.1"
    "address of this computer to use (default: 127.0.0.1, for clients on this computer only)"
    step: Annotated[bool | None, Parameter(group=CLIENT, negative=())] = None
    (
        "in the place of real time, wait for exactly one command (set-point, arm or reset) after "
        "every HIGHRES_IMU; 2 s at most"
    )
    realtime_rate: Annotated[float | None, Parameter(group=CLIENT)] = None
    "1 = real time, 0.5 = half as fast, 0 = as fast as it can (default: 1, with --step 0)"
    runs: Annotated[Whole, Parameter(group=CLIENT)] = 1
    "races, before the command ends; a reset does not count; 0 = until Ctrl-C (default: 1)"
    output: Annotated[Path | None, Parameter(group=RUN, metavar="DIR")] = None
    "where the results go, a folder without results in it (default: runs/<UTC time>-...)"
    meshcat: Annotated[bool, Parameter(group=RUN)] = True
    "show the race in a browser and leave a replay (default: yes)"
    linger: Annotated[float | None, Parameter(group=RUN, metavar="S")] = None
    "how long the page stays after the last race, in seconds (default: while somebody watches)"
    allow_origin: Annotated[
        tuple[str, ...], Parameter(group=RUN, metavar="ORIGIN", negative=())
    ] = ()
    "a proxy that the page is opened through, such as https://hub.example.org; may be repeated"
    record: Annotated[Literal["none", "light", "full"] | None, Parameter(group=RUN)] = None
    "what race.mcap holds: light = all signals, full = and pictures (default: full)"
    tlog: Annotated[bool, Parameter(group=RUN, negative=())] = False
    "write every MAVLink message of both sides to race.tlog, and say each second what came"
    foxglove: Annotated[bool, Parameter(group=RUN, negative=())] = False
    "serve the topics of race.mcap while they are written, for Foxglove: ws://localhost:8765"


def add_to(app: App) -> None:
    """Adds the subcommand to the command line."""
    app.command(grand_prix, name="grand-prix", help_epilogue=EPILOG)


@sigterm_as_ctrl_c()
def grand_prix(*, options: GrandPrixOptions = GrandPrixOptions()) -> int:
    """Simulate the AI Grand Prix for a client that speaks MAVLink."""
    return 0 if fly_grand_prix(options)["finished"] else 1


def grand_prix_scenario(options: GrandPrixOptions) -> "Scenario":
    """Returns the checked Scenario that options ask for.

    Raises:
        UserError: naming the option or the field and the remedy.
    """
    if options.scenario_file is None:
        options = dc.replace(options, scenario_file=SCENARIO_FILE)
    if options.course is not None and options.track is not None:
        raise UserError("--course and --track exclude each other: leave one of them out.")
    scenario = resolve_scenario(options)
    config = scenario.mavlink
    config.vq = config.vq if options.vq is None else options.vq
    scenario.track = scenario.track if options.course is None else _COURSES.get(config.vq, "")
    config.step = config.step if options.step is None else options.step
    if config.step:
        if options.realtime_rate:
            raise UserError("--realtime_rate and --step exclude each other: leave one of them out.")
        scenario.simulator_config.target_realtime_rate = 0.0
    config.dialect = config.dialect if options.quirks is None else options.quirks
    scenario.check()
    if scenario.estimator != "vio" or scenario.referee.contacts_end or scenario.map:
        raise UserError(
            "A client flies scenarios with an IMU, whose contacts do not end the race: begin with "
            "--scenario_file grand_prix, or set estimator: vio and referee: {contacts_end: false}."
        )
    return scenario


def addresses(options: GrandPrixOptions, dialect: "Dialect") -> "Addresses":
    """Returns where the client is; raises UserError if --client is no host and port."""
    from airrace.mavlink.client_link import Addresses

    host, _, port = options.client.rpartition(":")
    ports = (int(port) if port.isdecimal() else 0, options.picture_port)
    if not host or not all(0 < each < 65536 for each in ports):
        raise UserError(
            f"--client {options.client} and --picture_port {options.picture_port}: give a host and "
            "a port from 1 to 65535, such as 127.0.0.1:14550, and a port of pictures."
        )
    return Addresses(
        host, *ports, options.bind, dialect.port, dialect.picture_port, dialect.fixed_port
    )


def fly_grand_prix(options: GrandPrixOptions) -> dict:
    """Flies races of a client and shows them on the terminal; returns the last race.json.

    Raises:
        UserError: on bad input.
    """
    with contextlib.suppress(BrokenPipeError):  # whoever reads the lines may leave
        return _fly(options)
    return {"finished": False}


def _fly(options: GrandPrixOptions) -> dict:
    require_pymavlink()
    from airrace.common.files import results_folder, run_path
    from airrace.mavlink.client_link import ClientLink
    from airrace.mavlink.client_log import FILE as TLOG
    from airrace.mavlink.client_log import ClientLog
    from airrace.mavlink.dialects import DIALECTS
    from airrace.mavlink.grand_prix import fly_attempts, warm_up_grand_prix
    from airrace.recording.foxglove_server import FoxgloveServer
    from airrace.track import load_track
    from airrace.vehicle import load_vehicle
    from airrace.visualization import reach
    from airrace.visualization.course_display import CourseDisplay
    from airrace.visualization.live_page import LivePage

    scenario = grand_prix_scenario(options)
    track, (vehicle, _) = load_track(scenario.track), load_vehicle(scenario.drone)
    dialect = DIALECTS[scenario.mavlink.dialect]
    folder = options.output or run_path(track.name, vehicle.name, "mavlink")
    numbered = options.output is None
    display = CourseDisplay(scenario, track)
    with contextlib.ExitStack() as stack:
        link = stack.enter_context(
            contextlib.closing(ClientLink(addresses(options, dialect), display.note))
        )
        output = stack.enter_context(results_folder(folder, numbered=numbered, refuse=RESULTS))
        foxglove = stack.enter_context(FoxgloveServer()) if options.foxglove else None
        sinks: list[Sink] = [display.take]
        if options.tlog:
            log = stack.enter_context(ClientLog(output / TLOG, display.note))
            link.tap = log.tap
            sinks.append(log.take)
        display.announce("Preparing; the first time, inner loops are compiled, about a minute")
        warm_up_grand_prix(scenario)
        display.open(f"{options.client}, pictures at port {options.picture_port}")
        pages: list[Any] = []

        @contextlib.contextmanager
        def open_page() -> Iterator[LivePage | None]:
            while pages:
                pages.pop().close()
            page = None
            if options.meshcat:
                page = LivePage(track, allow_origin=options.allow_origin)
                page.note = display.note
                pages.append(page)
                for line in reach.lines(page.url):
                    display.note(line)
            yield page

        stack.callback(lambda: [page.close() for page in pages])
        attempts = fly_attempts(
            scenario, link, _folders(output, options.runs), pages=open_page, sinks=sinks,
            foxglove=foxglove,
        )  # fmt: skip
        data: dict = {"finished": False}
        for data, place, resets in attempts:
            display.print_result(data, place, resets)
        if pages and data["finished"]:
            pages[-1].linger(output, options.linger, display.note)
    return data


def require_pymavlink() -> None:
    """Raises UserError if pymavlink, which an extra installs, is not there."""
    try:
        import pymavlink.dialects.v20.common  # noqa: F401
    except ImportError:
        raise UserError(
            "A client is spoken to with pymavlink, which is missing: install it with "
            "`pip install 'airrace[mavlink]'`, or `pip install pymavlink`."
        ) from None


def _folders(output: Path, runs: int) -> Iterator[Path]:
    """Yields the folder of each race: that of the results, or for several, one in it each."""
    if runs == 1:
        yield output
        return
    for number in itertools.count(1) if runs == 0 else range(1, runs + 1):
        folder = output / f"race_{number:03d}"
        folder.mkdir(exist_ok=True)
        yield folder
