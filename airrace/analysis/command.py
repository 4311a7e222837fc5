"""airrace report and airrace tables: what a run left, as a page and as tables."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from airrace.common.waiting import waiting
from airrace.recording.race_json import check_run

EPILOG = """\
examples:
  airrace tables runs/NAME                  which tables there are
  airrace tables runs/NAME --export tables  all of them as CSV
  airrace tables runs/NAME --export tables --format parquet

In Python: run = airrace.load_run("runs/NAME"); run.state"""


def add_to(app: App) -> None:
    """Adds the subcommands to the command line."""
    app.command(report, help_epilogue="example: airrace report runs/NAME")
    app.command(tables, help_epilogue=EPILOG)


def report(run: Annotated[Path, Parameter(metavar="RUN")], /) -> int:
    """Write report.html of a run, a page that needs nothing else; a race does so when it ends.

    Args:
        run: the folder that a race left
    """
    check_run(run)
    with waiting("Writing report.html"):
        from airrace.analysis.report import write_report

        path = write_report(run)
    print(f"Report: {path}")
    return 0


def tables(
    run: Annotated[Path, Parameter(metavar="RUN")],
    /,
    *,
    export: Annotated[Path | None, Parameter(metavar="DIR")] = None,
    format: Literal["csv", "parquet"] = "csv",
) -> int:
    """Turn what a race left into tables of every signal.

    Args:
        run: the folder that a race left
        export: write every table to a file here
        format: of the files (default: csv)
    """
    from rich.console import Console
    from rich.table import Table

    check_run(run)
    with waiting("Reading what was recorded"):
        from airrace.analysis.run import load_run

        race = load_run(run)
    if export is not None:
        with waiting("Writing the tables"):
            paths = race.export(export, format)
        print(f"{len(paths)} tables: {export}")
        return 0
    table = Table("table", "rows", "columns")
    for name, signal in race.tables.items():
        table.add_row(name, str(len(signal)), ", ".join(map(str, signal)))
    Console().print(table)
    return 0
