"""airrace report: report.html of a run once more."""

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter


def add_to(app: App) -> None:
    """Adds the subcommand to the command line."""
    app.command(report, help_epilogue="example: airrace report runs/NAME")


def report(run: Annotated[Path, Parameter(metavar="RUN")], /) -> int:
    """Write report.html of a run, a page that needs nothing else; a race does so when it ends.

    Args:
        run: the folder that a race left
    """
    from rich.console import Console

    from airrace.analysis.report import write_report

    with Console(stderr=True).status("Writing report.html ..."):
        path = write_report(run)
    print(f"Report: {path}")
    return 0
