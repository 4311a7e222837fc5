"""The command line of a race: python -m airrace.diagrams.race, or ./run.bash."""

import contextlib
import sys
from pathlib import Path

from airrace.common.errors import UserError, exit_code
from airrace.diagrams.race_options import make_parser, resolve_scenario
from airrace.hitl.companion.options import ssh_companions


def main(argv=None) -> int:
    """The command-line program; returns its exit code."""
    return exit_code(lambda: run(make_parser().parse_args(argv)))


def run(args) -> int:
    """Runs the race of parsed arguments; returns the exit code."""
    from airrace.common.files import results_folder, run_path
    from airrace.diagrams.race import RESULTS, run_race
    from airrace.diagrams.warm_up import compile_apart
    from airrace.track import load_track
    from airrace.vehicle import load_vehicle
    from airrace.visualization.meshcat_page import MakeMeshcat
    from airrace.visualization.terminal import RaceDisplay

    make_companion = ssh_companions(args)
    scenario = resolve_scenario(args)
    track = load_track(scenario.track)
    vehicle, _ = load_vehicle(scenario.drone)
    if args.graphviz is not None:
        write_graphviz(args.graphviz, scenario)
    kind = f"{scenario.trajectory}d" if scenario.trajectory.isdigit() else scenario.trajectory
    folder = args.output or run_path(track.name, vehicle.name, kind)
    with results_folder(folder, numbered=args.output is None, refuse=RESULTS) as output_dir:
        meshcat = MakeMeshcat(track) if args.meshcat else None
        compile_apart(scenario)  # after the cheap checks: it may take a minute
        with contextlib.ExitStack() as stack:
            display = RaceDisplay(scenario, track, meshcat)
            stack.callback(display.close)
            if args.report:
                stack.enter_context(report_after(output_dir, display.announce))
            transport = None
            if args.simulation == "HITL":
                from airrace.diagrams.hitl_race import remote_transport

                transport = stack.enter_context(
                    remote_transport(args, scenario, output_dir, make_companion, display.note)
                )
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


@contextlib.contextmanager
def report_after(folder: Path, announce):
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


if __name__ == "__main__":
    sys.exit(main())
