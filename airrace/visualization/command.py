"""airrace replay: flown races again, in a browser or as a page."""

import os
import urllib.parse
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from airrace.common.command_line import Whole
from airrace.common.errors import UserError
from airrace.common.waiting import waiting
from airrace.recording.race_json import check_run

EPILOG = """\
examples:
  airrace replay runs/NAME                        in a browser, with controls
  airrace replay runs/A runs/B                    both together, from the start
  airrace replay runs/A runs/B --align lap --lap 2   both cross gate 1 at once
  airrace replay runs/A --html a.html             a page that opens offline

The page plays at any speed, jumps to laps and gates, and saves films; ? lists its keys."""


def add_to(app: App) -> None:
    """Adds the subcommand to the command line."""
    app.command(replay, help_epilogue=EPILOG)


def replay(
    run: Annotated[Path, Parameter(metavar="RUN")],
    /,
    *others: Annotated[Path, Parameter(metavar="RUN")],
    align: Literal["start", "lap"] = "start",
    lap: Whole | None = None,
    html: Annotated[Path | None, Parameter(metavar="FILE")] = None,
    allow_origin: Annotated[tuple[str, ...], Parameter(metavar="ORIGIN", negative=())] = (),
) -> int:
    """Show one or several runs of a track again, together, from their race.mcap.

    Args:
        run: the folder that a race left
        others: of the same track, to show beside it
        align: what happens at the same time in all: power on, or gate 1 at the beginning of
            --lap (default: start)
        lap: the lap that --align lap begins with (default: 1)
        html: write a page that opens offline, and exit
        allow_origin: a proxy through which you open the page, such as https://hub.example.org;
            may be repeated
    """
    if lap is not None and align != "lap":
        raise UserError("--lap needs --align lap.")
    for folder in (run, *others):
        check_run(folder)
    with waiting("Reading what was recorded"):  # to import what reads it takes its time, too
        from airrace.analysis.run import load_run
        from airrace.common.files import write_text
        from airrace.visualization import reach
        from airrace.visualization.ghosts import make_ghosts, replay_page
        from airrace.visualization.loopback_server import Visitors
        from airrace.visualization.page_server import serve_page

        visitors = Visitors(allow_origin)
        ghosts = make_ghosts([load_run(folder) for folder in (run, *others)], align, lap or 1)
    with waiting("Drawing the page"):
        page = replay_page(ghosts, _links(run, html))
    for ghost in ghosts:
        name = ghost.color if len(ghosts) > 1 else "the drone"
        print(f"{name}: {ghost.run.folder}")
    if html is not None:
        write_text(html, page)
        print(f"Replay: {html}")
        return 0

    def announce(url: str) -> None:
        print(*reach.lines(url), "Ctrl-C ends it.", sep="\n", flush=True)

    try:
        serve_page(page, announce, visitors)
    except KeyboardInterrupt:
        pass
    return 0


def _links(run: Path, html: Path | None) -> list:
    """Returns links from a replay's page to what the run left beside it."""
    report = (run if run.is_dir() else run.parent) / "report.html"
    if html is None or not report.exists():
        return []
    return [("report", urllib.parse.quote(os.path.relpath(report, html.parent)))]
