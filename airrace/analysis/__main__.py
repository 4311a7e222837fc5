"""Exports a run's tables: python -m airrace.analysis RUN --export DIR."""

import argparse
import sys
from pathlib import Path

from airrace.common.errors import exit_code

EPILOG = """\
examples:
  python -m airrace.analysis runs/NAME                  which tables there are
  python -m airrace.analysis runs/NAME --export tables  all of them as CSV
  python -m airrace.analysis runs/NAME --export tables --format parquet
  python -m airrace.analysis.report runs/NAME           report.html once more

In Python: from airrace.analysis import load_run; run = load_run("runs/NAME"); run.state
"""


def make_parser() -> argparse.ArgumentParser:
    """Returns the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="airrace.analysis",
        epilog=EPILOG,
        description="Turn what a race left into tables of every signal.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("run", metavar="RUN", type=Path, help="the folder that a race left")
    parser.add_argument(
        "--export", metavar="DIR", type=Path, help="write every table to a file here"
    )
    parser.add_argument(
        "--format", choices=("csv", "parquet"), default="csv", help="of the files (default: csv)"
    )
    return parser


def run(args) -> int:
    """Exports or lists the tables; returns the exit code."""
    from rich.console import Console
    from rich.table import Table

    from airrace.analysis.run import load_run

    console = Console()
    with console.status("Reading ..."):
        race = load_run(args.run)
    if args.export is not None:
        with console.status("Writing ..."):
            paths = race.export(args.export, args.format)
        print(f"{len(paths)} tables: {args.export}")
        return 0
    table = Table("table", "rows", "columns")
    for name, signal in race.tables.items():
        table.add_row(name, str(len(signal)), ", ".join(signal))
    console.print(table)
    return 0


def main(argv=None) -> int:
    """The command-line program; returns its exit code."""
    return exit_code(lambda: run(make_parser().parse_args(argv)))


if __name__ == "__main__":
    sys.exit(main())
