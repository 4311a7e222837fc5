"""The command line of a race: python -m airrace.diagrams.race, or ./run.bash."""

import contextlib
import logging
import sys
from pathlib import Path

from airrace.common.errors import UserError, exit_code
from airrace.diagrams.options import make_parser, resolve_scenario
from airrace.hitl.companion.options import ssh_companions


def main(argv=None) -> int:
    """The command-line program; returns its exit code."""
    args = make_parser().parse_args(argv)
    return exit_code(lambda: run(args))


def run(args) -> int:
    """Runs the race of parsed arguments; returns the exit code."""
    from airrace.common.files import results_folder, run_path
    from airrace.diagrams.race import RESULTS, run_race
    from airrace.diagrams.warm_up import compile_apart
    from airrace.track import load_track
    from airrace.vehicle import load_vehicle
    from airrace.visualization.terminal import RaceDisplay

    scenario = resolve_scenario(args)
    track = load_track(scenario.track)
    vehicle, _ = load_vehicle(scenario.drone)
    if args.graphviz is not None:
        write_graphviz(args.graphviz, scenario)
    kind = f"{scenario.trajectory}d" if scenario.trajectory.isdigit() else scenario.trajectory
    folder = args.output or run_path(track.name, vehicle.name, kind)
    with results_folder(folder, numbered=args.output is None, refuse=RESULTS) as output_dir:
        meshcat = make_meshcat(track) if args.meshcat else None
        compile_apart(scenario)  # whoever named a bad folder does not wait for it
        with (
            contextlib.closing(RaceDisplay(scenario, track, meshcat)) as display,
            report_after(args.report, output_dir, display.work),
            make_transport(args, scenario, output_dir, display.note) as transport,
        ):
            result = run_race(
                scenario, output_dir, meshcat=meshcat, show=display.show, transport=transport
            )
    display.print_summary(result, output_dir)
    return 0 if result["finished"] else 1


def write_graphviz(path: Path, scenario) -> None:
    """Writes the diagram of a race in Graphviz's dot language."""
    from airrace.diagrams.race import MakeRace

    try:
        path.write_text(MakeRace(scenario).GetGraphvizString(), encoding="utf-8")
    except OSError as e:
        raise UserError(
            f"--graphviz {path} cannot be written ({e.strerror}); name another file."
        ) from None


def make_meshcat(track):
    """Returns a Meshcat that looks at the track."""
    from airrace.visualization.race_view import MakeMeshcat

    logging.getLogger("drake").setLevel(logging.WARNING)  # the display says where to look
    try:
        return MakeMeshcat(track)
    except RuntimeError as e:
        raise UserError(
            f"The race cannot be shown in a browser ({str(e).rstrip('.')}); close another "
            "program that uses Meshcat, or race with --no-meshcat."
        ) from None


@contextlib.contextmanager
def report_after(wanted: bool, folder: Path, work):
    """Writes report.html after the block, also if that raises; then, nothing else is raised.

    Args:
        wanted: whether to do it at all.
        folder: of the race.
        work: context manager, called with what is being done.
    """

    def write():
        from airrace.analysis.report import write_report

        with work("Writing report.html"):
            write_report(folder)

    try:
        yield
    except BaseException:
        if wanted and (folder / "race.json").exists():
            with contextlib.suppress(Exception):
                write()
        raise
    if wanted:
        write()


def make_transport(args, scenario, output_dir: Path, note):
    """Returns a context manager of where the autonomy is: None, or see remote_transport()."""
    make_companion = ssh_companions(args)
    if args.simulation == "SITL":
        return contextlib.nullcontext()
    from airrace.diagrams.hitl_race import default_url, remote_transport

    return remote_transport(
        scenario,
        output_dir,
        companion=args.companion,
        lockstep=args.lockstep,
        note=note,
        url=args.lcm_url or default_url(args.companion),
        make_companion=make_companion,
    )


if __name__ == "__main__":
    sys.exit(main())
