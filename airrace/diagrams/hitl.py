"""Either side of a HITL race by hand, and the doctor: python -m airrace.diagrams.hitl."""

import argparse
import sys
from pathlib import Path

from airrace.common.errors import exit_code
from airrace.diagrams.race_options import add_scenario_options, make_parser
from airrace.hitl.companion import READY

_DOCTOR_TIME = 10.0  # s
EPILOG = """\
examples, on two computers on one cable (see the README):
  python -m airrace.diagrams.hitl --role autonomy --lcm_url 'udpm://239.255.76.67:7667?ttl=1'
  python -m airrace.diagrams.hitl --role simulation --lcm_url 'udpm://239.255.76.67:7667?ttl=1'
  python -m airrace.diagrams.hitl --doctor --lcm_url 'udpm://239.255.76.67:7667?ttl=1'

The autonomy is started first, and ends with the race: 0 after it, 3 if the
simulation falls silent, 1 on Ctrl-C, 2 on bad input. Both sides need the same
scenario. The simulation takes all options of ./run.bash. The doctor needs an
autonomy that waits at the other end.
"""


def make_hitl_parser() -> argparse.ArgumentParser:
    """Returns the parser of the command line, without the simulation's own options."""
    parser = argparse.ArgumentParser(
        prog="python -m airrace.diagrams.hitl",
        description="Run one side of a race whose autonomy is at the other end of a cable.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--role", choices=("simulation", "autonomy"), help="which side")
    what.add_argument("--doctor", action="store_true", help="measure the link and say what to mend")
    parser.add_argument(
        "--lcm_url",
        metavar="URL",
        help="of LCM; ttl=0 stays on this computer, ttl=1 leaves it "
        "(default: udpm://239.255.76.67:7667?ttl=0)",
    )
    parser.add_argument(
        "--output",
        type=Path,
        metavar="DIR",
        default=Path("autonomy"),
        help="the autonomy: where its map and its checkpoint go (default: autonomy)",
    )
    parser.add_argument(
        "--resume",
        type=Path,
        metavar="DIR",
        help="the autonomy: go on in a race that is on, with the checkpoint in "
        "the --output folder of the one that has ended; only of a folder that "
        "you trust, it can hold code",
    )
    parser.add_argument(
        "--patience",
        type=float,
        default=60.0,
        metavar="S",
        help="how long to wait for the other side (default: 60 s)",
    )
    parser.add_argument(
        "--duration",
        type=float,
        default=_DOCTOR_TIME,
        metavar="S",
        help=f"the doctor: how long to measure (default: {_DOCTOR_TIME:.0f} s)",
    )
    add_scenario_options(parser)
    return parser


def _scenario_and_bus(args):
    from airrace.hitl.link.endpoint import DEFAULT_URL, open_lcm
    from airrace.scenario import load_scenario

    scenario = load_scenario(
        filename=args.scenario_file,
        scenario_name=args.scenario_name,
        scenario_text=args.scenario_text,
    )
    scenario.check()
    return scenario, open_lcm(args.lcm_url or DEFAULT_URL)


def run_autonomy(args) -> int:
    """Runs the autonomy; returns the exit code."""
    from airrace.common.files import results_folder
    from airrace.common.interrupts import interrupt_flag
    from airrace.diagrams.autonomy_process import AutonomyProcess
    from airrace.diagrams.warm_up import warm_up

    scenario, bus = _scenario_and_bus(args)
    with interrupt_flag() as interrupted:
        warm_up(scenario, briefly=args.resume is not None)
        with results_folder(args.output) as folder:
            process = AutonomyProcess(scenario, bus, folder, stop=lambda: interrupted.is_set)
            print(READY, flush=True)
            return process.run(resume=args.resume, patience=args.patience)


def run_doctor(args) -> int:
    """Measures the link; returns the exit code."""
    from rich.console import Console
    from rich.progress import Progress

    from airrace.hitl.link.doctor import diagnose, make_table, refusal
    from airrace.hitl.link.probe import measure

    scenario, bus = _scenario_and_bus(args)
    console = Console()
    with Progress(console=console, transient=True) as progress:
        task = progress.add_task("measuring the link", total=1.0)
        findings = measure(
            bus,
            scenario,
            args.duration,
            show=lambda share: progress.update(task, completed=share),
            patience=args.patience,
        )
    rows = diagnose(findings)
    console.print(make_table(rows))
    reason = refusal(rows)
    console.print(reason or "A race can start.", markup=False, highlight=False)
    return 1 if reason else 0


def main(argv=None) -> int:
    """The command-line program; returns its exit code."""
    parser = make_hitl_parser()
    args, rest = parser.parse_known_args(argv)
    if args.role == "simulation":
        from airrace.diagrams.hitl_race import BY_HAND
        from airrace.diagrams.race_command import run

        role = argparse.ArgumentParser(add_help=False)
        role.add_argument("--role")
        _, others = role.parse_known_args(argv)
        race = make_parser().parse_args([*others, "-s", "HITL", "--companion", BY_HAND])
        return exit_code(lambda: run(race))
    if rest:
        parser.error(f"unrecognized arguments: {' '.join(rest)}")
    return exit_code(lambda: run_doctor(args) if args.doctor else run_autonomy(args))


if __name__ == "__main__":
    sys.exit(main())
