"""Evaluates the autonomy over many races: python -m airrace.diagrams.evaluate."""

import argparse
import os
import sys
from pathlib import Path

from airrace.common.errors import UserError, exit_code
from airrace.common.interrupts import interrupts_held, sigterm_as_ctrl_c
from airrace.diagrams.race_options import (
    add_drone_options,
    add_level_option,
    add_scenario_options,
    resolve_scenario,
)

EPILOG = """\
examples:
  python -m airrace.diagrams.evaluate --tracks 100 --laps 3 --output runs/first
  python -m airrace.diagrams.evaluate --tracks 100 --laps 3 --output runs/first --resume
  python -m airrace.diagrams.evaluate --track student-airrace --tracks 20 -t 4
  python -m airrace.diagrams.evaluate --scenario_file races --scenario_name Wind
  python -m airrace.diagrams.evaluate --scheduler tcp://192.168.1.5:8786

Race i = 0, 1, ... flies the generated track of seed track_seed + i, or the one of
--track, with that seed for all other randomness; the scenario's own track and seed
are not used. A seed without a track is said before anything flies. Every race is
a process of its own; what crashes one is the reason why that one did not finish.

The output folder:
  races.jsonl      one line a race, written when it ends: race.json and wall times
  evaluation.json  settings, numbers, and every race; the same whoever flew it
  evaluation.md    the tables
  evaluation.png   the picture

Any Dask cluster will do whose workers have the same airrace and packages:
  dask scheduler --host 127.0.0.1 --port 8786 --no-dashboard
  dask worker tcp://127.0.0.1:8786 --nworkers 2 --nthreads 1 --no-dashboard
A worker flies as many races at once as it has threads. Whoever reaches a
scheduler can run code on its workers: keep both inside a network that you trust.

Exit codes: 0 all races have ended, finished or not; 1 the evaluation was ended
early, by Ctrl-C or a lost scheduler, and --resume goes on with it; 2 bad input.
"""


def make_parser() -> argparse.ArgumentParser:
    """Returns the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="airrace-evaluate",
        description="Race on many tracks, and tell how often and how fast the drone finishes.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    races = parser.add_argument_group("the races")
    races.add_argument(
        "--tracks",
        type=int,
        default=20,
        metavar="N",
        help="number of races, each on a track of its own (default: 20)",
    )
    races.add_argument(
        "--track_seed",
        type=int,
        default=1000,
        metavar="N",
        help="seed of the first track and race (default: 1000)",
    )
    races.add_argument(
        "--track",
        metavar="NAME|FILE",
        help="fly all races on this shipped track or YAML file instead",
    )
    races.add_argument(
        "--laps",
        type=int,
        metavar="N",
        help="laps of each race after exploring (default: the scenario's)",
    )
    add_level_option(races, "(default: 1, unless --scenario_file is given)")
    add_drone_options(races)
    run = parser.add_argument_group("the run")
    run.add_argument(
        "--output",
        type=Path,
        metavar="DIR",
        help="where the results go, a folder without an evaluation in it "
        "(default: runs/<UTC time>-evaluation-<drone>)",
    )
    run.add_argument(
        "--resume",
        action="store_true",
        help="go on with the evaluation in --output, if there is one: only the races "
        "that it lacks are flown",
    )
    where = run.add_mutually_exclusive_group()
    where.add_argument(
        "--workers",
        type=int,
        metavar="N",
        help="processes on this machine (default: one a processor)",
    )
    where.add_argument(
        "--scheduler", metavar="tcp://HOST:PORT", help="a running Dask cluster instead"
    )
    add_scenario_options(parser)
    parser.set_defaults(simulation="SITL", lockstep=False, lcm_url=None, record="none")
    return parser


def check_options(args) -> None:
    """Raises UserError on the first bad option of this program's own."""
    for name, least in (("tracks", 1), ("track_seed", 0), ("workers", 1)):
        value = getattr(args, name)
        if value is not None and value < least:
            raise UserError(f"--{name} must be at least {least}, not {value}.")
    if args.resume and args.output is None:
        raise UserError("--resume needs --output, the folder of the evaluation to go on with.")
    if args.scenario_name is not None and args.scenario_file is None:
        raise UserError("--scenario_name needs --scenario_file.")


def resolve(args) -> tuple[list, dict]:
    """Returns the jobs and the settings that the command line asks for.

    Raises:
        UserError: naming the option or the field and the remedy.
    """
    from rich.console import Console
    from rich.progress import track as progress

    from airrace.evaluation.jobs import generated_track, given_track, make_jobs, settings
    from airrace.vehicle import load_vehicle

    check_options(args)
    if args.level is None and args.scenario_file is None:
        args.level = 1
    scenario = resolve_scenario(args)
    name = args.scenario_name or f"{args.scenario_file} Defaults"
    load_vehicle(scenario.drone)
    seeds = range(args.track_seed, args.track_seed + args.tracks)
    if args.track is not None:
        tracks = [given_track(args.track)] * args.tracks
    else:
        console = Console(stderr=True)
        bar = dict(console=console, transient=True, disable=not console.is_terminal)
        tracks = [generated_track(seed) for seed in progress(seeds, "Making tracks", **bar)]
    jobs = make_jobs(scenario, seeds, tracks)
    return jobs, settings(
        jobs,
        track=f"the track {args.track}" if args.track else "generated tracks",
        scenario_name=name if args.level is None else f"Level{args.level}",
    )


@sigterm_as_ctrl_c()
def run(args) -> int:
    """Evaluates by parsed arguments; returns the exit code."""
    from airrace.common.files import results_folder, run_path
    from airrace.evaluation.store import RaceStore

    jobs, settings = resolve(args)
    output = args.output or run_path("evaluation", Path(settings["scenario"]["drone"]).name)
    with results_folder(output, numbered=args.output is None) as folder:
        with RaceStore(folder, settings, resume=args.resume) as store:
            return evaluate(args, jobs, settings, folder, store)


def evaluate(args, jobs, settings, folder, store) -> int:
    """Flies the races that a store lacks, and reports; returns the exit code."""
    from airrace.evaluation import cluster
    from airrace.evaluation.progress import EvaluationDisplay

    missing = [job for job in jobs if job.seed not in store.seeds]
    display = EvaluationDisplay(settings, store.rows)
    stopped = None

    def keep(row):
        with interrupts_held():
            store.append(row)
        display.show(row)

    try:
        if missing:
            if args.scheduler is not None:
                connection = cluster.running_cluster(args.scheduler)
            else:
                connection = cluster.local_cluster(args.workers or os.cpu_count() or 1)
            with connection as client:
                cluster.check_workers(client, jobs[0].versions, jobs[0].systems)
                with display:
                    cluster.fly_races(client, missing, keep)
    except KeyboardInterrupt:
        stopped = "interrupted"
    except cluster.EvaluationStopped as e:
        stopped = str(e)
    except UserError:
        if len(store.rows) > len(jobs) - len(missing):
            report(folder, settings, store.rows, display)
        raise
    report(folder, settings, store.rows, display)
    if stopped:
        print(
            f"airrace: {stopped}; {len(store.rows)} of {len(jobs)} races are in {folder}: the "
            "same command with --resume flies the others.",
            file=sys.stderr,
        )
    return 1 if stopped else 0


def report(folder, settings, rows, display) -> None:
    """Writes evaluation.json, evaluation.md and evaluation.png, and prints the tables."""
    from airrace.evaluation.overview_plot import draw_picture
    from airrace.evaluation.tables import write_report

    evaluation = write_report(folder, settings, rows)
    draw_picture(folder, evaluation)
    display.print_summary(evaluation, folder)


def main(argv=None) -> int:
    """The command-line program; returns its exit code."""
    return exit_code(lambda: run(make_parser().parse_args(argv)))


if __name__ == "__main__":
    sys.exit(main())
