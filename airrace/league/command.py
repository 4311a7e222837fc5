"""airrace league: entries of a class race on hidden tracks, each in a sandbox of its own."""

import functools
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from airrace.common.command_line import Whole
from airrace.common.interrupts import sigterm_as_ctrl_c

if TYPE_CHECKING:
    from rich.status import Status

    from airrace.league.season_files import LeagueStore
    from airrace.league.season_run import Plan

EPILOG = """\
examples:
  airrace new entry herons                          an entry to begin with
  airrace league check herons                       would it be accepted? fly one lap
  airrace new season spring                         spring.yaml, and its secret seed
  airrace league run spring.yaml entries/* --output runs/spring
  airrace league run spring.yaml entries/* --output runs/spring --resume
  airrace league verify runs/spring/league.json --seed_file spring.seed

An entry's code runs in a process of its own in a sandbox (bubblewrap): without a
network, without the tracks, with nothing but the messages that a drone's computer
gets. `airrace league run --help` says what it leaves."""
RUN_EPILOG = """\
examples:
  airrace league run spring.yaml original optimal   two of the shipped entries
  airrace league run spring.yaml entries/* --output runs/spring --workers 2

The output folder:
  league.html      ranking, every race with its replay, what entries tried
  league.json      the same for programs, with hashes for `airrace league verify`
  flights.jsonl    one line a race, written when it ends
  races/ duels/    race.json and replay of each race; the best two of each together
  entries/ season.yaml   copies of what was flown; the secret seed is not among them

Exit codes: 0 all races have ended, finished or not; 1 the season was ended early,
by Ctrl-C or a lost scheduler, and --resume goes on with it; 2 bad input."""
VERIFY_EPILOG = """\
examples:
  airrace league verify runs/spring/league.json --seed_file spring.seed
  airrace league verify runs/spring/league.json --seed_file spring.seed --all
  airrace league verify runs/spring/league.json --entry herons --race 3

Everything in league.json is compared with what follows from the folder's
entries, its season.yaml, the secret seed and the races; then of each entry
the quickest race and one drawn at random are flown again, and must be equal
to the last bit.
What cannot follow, and is compared with hashes in league.json only: pages,
replays, logs, maps, who was refused and why, whether there was a sandbox,
and of races that are not flown again how the entry behaved. So is the season
itself: publish the hash of season.yaml before it is flown, and that of
league.json after, which this command prints.
Exit codes: 0 nothing is wrong; 1 something is; 2 bad input."""

Unsafe = Annotated[bool, Parameter(negative=())]
_SEED_FILE = Annotated[Path | None, Parameter(metavar="FILE")]


def add_to(app: App) -> None:
    """Adds the subcommand to the command line."""
    league = App(name="league", help="Let the entries of a class race on hidden tracks.")
    league.help_epilogue = EPILOG
    league.command(check)
    league.command(run, help_epilogue=RUN_EPILOG)
    league.command(verify, help_epilogue=VERIFY_EPILOG)
    app.command(league)


@sigterm_as_ctrl_c()
def check(
    entry: Annotated[str, Parameter(metavar="FOLDER")],
    /,
    *,
    unsafe: Unsafe = False,
    flight: bool = True,
) -> int:
    """Say whether an entry would be accepted, and fly one lap with it.

    Exit codes: 0 it would, and finished the lap; 1 it did not finish; 2 it would not.

    Args:
        entry: its folder, or the name of a shipped one
        unsafe: fly without a sandbox, where this computer offers none
        flight: fly the lap (default: yes)
    """
    from rich.console import Console

    from airrace.evaluation.races_display import print_line
    from airrace.league.check import fly_check, show_entry, show_flight
    from airrace.league.entry import load_entry
    from airrace.league.sandbox import check_sandbox, why_no_sandbox

    accepted = load_entry(entry)
    console = Console()
    show = functools.partial(print_line, console)
    show_entry(accepted, why_no_sandbox(), show)
    if not flight:
        return 0
    check_sandbox(unsafe)
    with Console(stderr=True).status("Flying one lap of the hexagon; about half a minute"):
        row = fly_check(accepted, safe=why_no_sandbox() is None)
    show_flight(row, show)
    return 0 if row["result"]["finished"] else 1


@sigterm_as_ctrl_c()
def run(
    season: Annotated[Path, Parameter(metavar="SEASON")],
    first: Annotated[str, Parameter(metavar="ENTRY")],
    /,
    *others: Annotated[str, Parameter(metavar="ENTRY")],
    output: Annotated[Path | None, Parameter(metavar="DIR")] = None,
    resume: Annotated[bool, Parameter(negative=())] = False,
    workers: Whole | None = None,
    scheduler: Annotated[str | None, Parameter(metavar="tcp://HOST:PORT")] = None,
    unsafe: Unsafe = False,
) -> int:
    """Fly a season: every entry on every track, and rank them.

    Args:
        season: its YAML file
        first: folder of an entry, or the name of a shipped one
        others: more of them
        output: where the results go (default: runs/<UTC time>-league-<season>)
        resume: go on with the season in --output: only races that it lacks are flown
        workers: races at a time on this computer (default: one a processor that it may use)
        scheduler: a running Dask cluster instead of --workers
        unsafe: fly entries without a sandbox, where this computer offers none
    """
    from airrace.common.files import results_folder, run_path
    from airrace.diagrams.race import RESULTS
    from airrace.evaluation.command import check_flying
    from airrace.league.sandbox import check_sandbox, why_no_sandbox
    from airrace.league.season_files import LeagueStore, keep_sources, settings
    from airrace.league.season_run import make_plan

    check_flying(output, resume, workers, scheduler)
    check_sandbox(unsafe)
    safe = why_no_sandbox() is None
    with _status("Making tracks"):
        plan = make_plan(season, [first, *others], safe)
    flown = {"versions": plan.flights[0].versions, "safe": safe}
    told = settings(plan.season, plan.secret, plan.entries, plan.refused, flown)
    path = output or run_path("league", plan.season.name)
    with results_folder(path, numbered=output is None, refuse=RESULTS) as folder:
        with LeagueStore(folder, told, resume=resume) as store:
            keep_sources(folder, season, plan.entries)
            return _fly(plan, told, folder, store, (workers, scheduler))


def _fly(
    plan: "Plan",
    settings: dict,
    folder: Path,
    store: "LeagueStore",
    cluster_options: tuple[int | None, str | None],
) -> int:
    """Flies what a store lacks, and shows them; returns the exit code."""
    from airrace.evaluation.cluster import fly_missing
    from airrace.evaluation.races_display import say_if_stopped
    from airrace.league.display import LeagueDisplay
    from airrace.league.season_files import keep_files
    from airrace.league.worker import fly

    with LeagueDisplay(plan, store.rows) as display:
        stopped = fly_missing(
            plan.flights,
            store,
            cluster_options,
            display.show,
            systems={},
            keep=lambda row: keep_files(folder, row),
            fly=fly,
        )
    _report(plan, settings, folder, store.rows)
    return say_if_stopped(stopped, len(store.rows), len(plan.flights), folder)


def _report(plan: "Plan", settings: dict, folder: Path, rows: list) -> None:
    """Writes league.json and league.html, and prints the ranking."""
    from airrace.league.display import print_ranking
    from airrace.league.page import make_duels, write_page
    from airrace.league.season_files import flight_lines, make_league, write_league

    league = make_league(settings, plan.legs, flight_lines(rows))
    write_league(folder, league)
    duels: list[dict] = []
    if plan.season.replays and league["complete"]:
        with _status("Drawing the best against the second") as status:
            duels = make_duels(
                folder, league, lambda leg: status.update(f"Drawing the best of race {leg}")
            )
    page = write_page(folder, league, duels)
    write_league(folder, league)  # again, with the hashes of what was drawn
    print_ranking(league, page)


@sigterm_as_ctrl_c()
def verify(
    league: Annotated[Path, Parameter(metavar="LEAGUE.JSON")],
    /,
    *,
    seed_file: _SEED_FILE = None,
    entry: Annotated[str | None, Parameter(metavar="NAME")] = None,
    race: Whole | None = None,
    all: Annotated[bool, Parameter(negative=())] = False,
    unsafe: Unsafe = False,
) -> int:
    """Check a season's result: compare its files, and fly races again.

    Args:
        league: the league.json in a season's folder
        seed_file: with the season's secret seed (default: the season's, beside league.json or
            in the working folder)
        entry: fly only this one's races again
        race: fly only the race with this number again
        all: fly all races again (default: of each entry the one with the quickest mean lap, and
            one of the season that is drawn at random)
        unsafe: fly entries without a sandbox, where this computer offers none
    """
    from airrace.league.proof import verify_league

    return verify_league(league, seed_file, (entry, race, all), unsafe)


def _status(text: str) -> "Status":
    from rich.console import Console

    return Console(stderr=True).status(text)
