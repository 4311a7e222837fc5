"""Draws a diagram as it was built: python -m airrace.diagrams.draw."""

import argparse
import sys
from pathlib import Path

from airrace.common.errors import UserError, exit_code

EPILOG = """\
examples:
  python -m airrace.diagrams.draw --output race.svg
  python -m airrace.diagrams.draw --part autonomy --output autonomy.svg
  python -m airrace.diagrams.draw --scenario_text '{systems: {explorer: "a:make"}}'

For Graphviz's own drawing of everything: ./run.bash --graphviz FILE.
"""
PARTS = ("race", "simulation", "autonomy")


def make_parser() -> argparse.ArgumentParser:
    """Returns the parser of the command line."""
    from airrace.diagrams.race import add_scenario_options

    parser = argparse.ArgumentParser(
        prog="airrace.diagrams.draw",
        epilog=EPILOG,
        description="Draw the boxes and wires of a race as an SVG picture.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--part",
        choices=PARTS,
        default="race",
        help="what to draw; the race is simulation and autonomy (default: race)",
    )
    parser.add_argument(
        "--output", type=Path, required=True, metavar="FILE", help="the SVG file to write"
    )
    add_scenario_options(parser)
    return parser


def draw(scenario, part: str) -> str:
    """Returns the SVG picture of a scenario's diagrams.

    Args:
        scenario: of the race.
        part: one of PARTS.

    Raises:
        UserError: if something the scenario names cannot be had.
    """
    from airrace.diagrams.autonomy import MakeAutonomy
    from airrace.diagrams.diagram_svg import diagram_svg
    from airrace.diagrams.simulation import MakeSimulation

    make = {"simulation": MakeSimulation, "autonomy": MakeAutonomy}
    names = list(make) if part == "race" else [part]
    return diagram_svg([make[name](scenario) for name in names])


def run(args) -> int:
    """Draws as parsed arguments ask for; returns the exit code."""
    from airrace.common.files import write_text
    from airrace.scenario import load_scenario

    if not args.output.parent.is_dir():
        raise UserError(
            f"--output {args.output}: there is no folder {args.output.parent}; make "
            "it, or name another file."
        )
    scenario = load_scenario(
        filename=args.scenario_file,
        scenario_name=args.scenario_name,
        scenario_text=args.scenario_text,
    )
    scenario.check()
    write_text(args.output, draw(scenario, args.part))
    print(f"Drawing: {args.output}")
    return 0


def main(argv=None) -> int:
    """The command-line program; returns its exit code."""
    args = make_parser().parse_args(argv)
    return exit_code(lambda: run(args))


if __name__ == "__main__":
    sys.exit(main())
