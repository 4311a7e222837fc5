"""airrace evaluate: how often and how fast the autonomy finishes, over many races."""

import dataclasses as dc
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from airrace.common.command_line import Whole
from airrace.common.errors import UserError
from airrace.common.interrupts import sigterm_as_ctrl_c
from airrace.scenario.options import RACE, RUN, DroneOptions, resolve_scenario

if TYPE_CHECKING:
    from airrace.evaluation.progress import EvaluationDisplay
    from airrace.evaluation.store import RaceStore

EPILOG = """\
examples:
  airrace evaluate --tracks 100 --laps 3 --output runs/first
  airrace evaluate --tracks 100 --laps 3 --output runs/first --resume
  airrace evaluate --track student-airrace --tracks 20 -t 4
  airrace evaluate --scenario_file races --scenario_name Wind
  airrace evaluate --scheduler tcp://192.168.1.5:8786

Race i = 0, 1, ... flies the generated track of seed track_seed + i, or the one of
--track, with that seed for all other randomness; the scenario's own track and seed
are not used. A seed without a track is said before anything flies. Every race is
a process of its own; what crashes one is the reason why that one did not finish.
Unless --level or --scenario_file is given, the races are those of --level 1.

The output folder:
  races.jsonl      one line a race, written when it ends: race.json and wall times
  evaluation.json  settings, numbers, and every race; the same whoever flew it
  evaluation.md    the tables
  evaluation.png   the picture
  evaluation.html  all of this to look into: races to be sorted, and what failed

Any Dask cluster will do whose workers have the same airrace and packages:
  dask scheduler --host 127.0.0.1 --port 8786 --no-dashboard
  dask worker tcp://127.0.0.1:8786 --nworkers 2 --nthreads 1 --no-dashboard
A worker flies as many races at once as it has threads. Whoever reaches a
scheduler can run code on its workers: keep both inside a network that you trust.

Exit codes: 0 all races have ended, finished or not; 1 the evaluation was ended
early, by Ctrl-C or a lost scheduler, and --resume goes on with it; 2 bad input."""


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class EvaluateOptions(DroneOptions):
    """What an evaluation may be told."""

    tracks: Annotated[Whole, Parameter(group=RACE)] = 20
    "number of races, each on a track of its own (default: 20)"
    track_seed: Annotated[Whole, Parameter(group=RACE)] = 1000
    "seed of the first track and race (default: 1000)"
    track: Annotated[str | None, Parameter(group=RACE, metavar="NAME|FILE")] = None
    "fly all races on this shipped track or YAML file instead"
    laps: Annotated[Whole | None, Parameter(group=RACE)] = None
    "laps of each race after exploring (default: the scenario's)"
    output: Annotated[Path | None, Parameter(group=RUN, metavar="DIR")] = None
    (
        "where the results go, a folder without results in it "
        "(default: runs/<UTC time>-evaluation-<drone>)"
    )
    resume: Annotated[bool, Parameter(group=RUN, negative=())] = False
    (
        "go on with the evaluation in --output, if there is one: only the races that it lacks are "
        "flown"
    )
    workers: Annotated[Whole | None, Parameter(group=RUN)] = None
    "races at a time on this machine (default: one a processor that it may use)"
    scheduler: Annotated[str | None, Parameter(group=RUN, metavar="tcp://HOST:PORT")] = None
    "a running Dask cluster instead of --workers"
    record: Annotated[str, Parameter(parse=False)] = "none"


def add_to(app: App) -> None:
    """Adds the subcommand to the command line."""
    app.command(evaluate, help_epilogue=EPILOG)


@sigterm_as_ctrl_c()
def evaluate(*, options: EvaluateOptions = EvaluateOptions()) -> int:
    """Race on many tracks, and tell how often and how fast the drone finishes."""
    from airrace.common.files import results_folder, run_path
    from airrace.diagrams.race import RESULTS
    from airrace.evaluation.store import RaceStore

    jobs, settings = resolve(options)
    output = options.output or run_path("evaluation", Path(settings["scenario"]["drone"]).name)
    with results_folder(output, numbered=options.output is None, refuse=RESULTS) as folder:
        with RaceStore(folder, settings, resume=options.resume) as store:
            return fly(options, jobs, settings, folder, store)


def check_options(options: EvaluateOptions) -> None:
    """Raises UserError on the first bad option of this program's own."""
    for name, least in (("tracks", 1), ("track_seed", 0)):
        if (value := getattr(options, name)) < least:
            raise UserError(f"--{name} must be at least {least}, not {value}.")
    check_flying(options.output, options.resume, options.workers, options.scheduler)
    if options.scenario_name is not None and options.scenario_file is None:
        raise UserError("--scenario_name needs --scenario_file.")


def check_flying(
    output: Path | None, resume: bool, workers: int | None, scheduler: str | None
) -> None:
    """Raises UserError on the first bad option of those that say where many races are flown."""
    if workers is not None and workers < 1:
        raise UserError(f"--workers must be at least 1, not {workers}.")
    if workers is not None and scheduler is not None:
        raise UserError("--workers and --scheduler exclude each other: leave one out.")
    if resume and output is None:
        raise UserError("--resume needs --output, the folder of the races to go on with.")


def resolve(options: EvaluateOptions) -> tuple[list, dict]:
    """Returns the jobs and the settings that the command line asks for.

    Raises:
        UserError: naming the option or the field and the remedy.
    """
    from rich.console import Console
    from rich.progress import track as progress

    from airrace.evaluation.jobs import generated_track, given_track, make_jobs, settings
    from airrace.vehicle import load_vehicle

    check_options(options)
    if options.level is None and options.scenario_file is None:
        options = dc.replace(options, level=1)
    scenario = resolve_scenario(options)
    scenario.check()
    name = options.scenario_name or f"{options.scenario_file} Defaults"
    load_vehicle(scenario.drone)
    seeds = range(options.track_seed, options.track_seed + options.tracks)
    if options.track is not None:
        tracks = [given_track(options.track)] * options.tracks
    else:
        console = Console(stderr=True)
        shown = progress(
            seeds, "Making tracks", console=console, transient=True, disable=not console.is_terminal
        )
        tracks = [generated_track(seed) for seed in shown]
    jobs = make_jobs(scenario, seeds, tracks)
    return jobs, settings(
        jobs,
        track=f"the track {options.track}" if options.track else "generated tracks",
        scenario_name=name if options.level is None else f"Level{options.level}",
    )


def fly(
    options: EvaluateOptions, jobs: list, settings: dict, folder: Path, store: "RaceStore"
) -> int:
    """Flies the races that a store lacks, and shows them; returns the exit code."""
    from airrace.evaluation import cluster
    from airrace.evaluation.progress import EvaluationDisplay
    from airrace.evaluation.races_display import say_if_stopped

    display, before = EvaluationDisplay(settings, store.rows), len(store.rows)
    where, systems = (options.workers, options.scheduler), jobs[0].systems
    try:
        stopped = cluster.fly_missing(
            jobs, store, where, display.show, systems=systems, live=display
        )
    except UserError:
        if len(store.rows) > before:
            write_results(folder, settings, store.rows, display)
        raise
    write_results(folder, settings, store.rows, display)
    return say_if_stopped(stopped, len(store.rows), len(jobs), folder)


def write_results(folder: Path, settings: dict, rows: list, display: "EvaluationDisplay") -> None:
    """Writes evaluation.json, .md, .png and .html, and prints the tables."""
    from airrace.evaluation.overview_plot import draw_picture
    from airrace.evaluation.page import write_page
    from airrace.evaluation.tables import write_summary

    evaluation = write_summary(folder, settings, rows)
    draw_picture(folder, evaluation)
    write_page(folder, evaluation, rows)
    display.print_summary(evaluation, folder)
