"""airrace replay: flown races again, in a browser or as a page."""

import time
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from airrace.commands.options import Whole

EPILOG = """\
examples:
  airrace replay runs/NAME                        in a browser, with controls
  airrace replay runs/A runs/B                    both together, from the start
  airrace replay runs/A runs/B --align lap --lap 2   both cross gate 1 at once
  airrace replay runs/A --html a.html             a page that opens offline

The page's controls, top right, play, pause, and go to any time: Animations > default."""


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
) -> int:
    """Show one or several runs of a track again, together, from their race.mcap.

    Args:
        run: the folder that a race left
        others: of the same track, to show beside it
        align: what happens at the same time in all: power on, or gate 1 at the beginning of
            --lap (default: start)
        lap: the lap that --align lap begins with (default: 1)
        html: write a page that opens offline, and exit
    """
    from rich.console import Console

    from airrace.analysis.run import load_run
    from airrace.common.errors import UserError
    from airrace.common.files import write_text
    from airrace.visualization.ghosts import make_ghosts, show_ghosts, with_legend
    from airrace.visualization.meshcat_page import MakeMeshcat

    if lap is not None and align != "lap":
        raise UserError("--lap needs --align lap.")
    with Console(stderr=True).status("Reading ...") as status:
        ghosts = make_ghosts([load_run(folder) for folder in (run, *others)], align, lap or 1)
        status.update("Drawing ...")
        meshcat = MakeMeshcat(ghosts[0].run.track)
        show_ghosts(meshcat, ghosts)
    for ghost in ghosts:
        name = ghost.color if len(ghosts) > 1 else "the drone"
        print(f"{name}: {ghost.run.folder}")
    if html is not None:
        write_text(html, with_legend(meshcat.StaticHtml(), ghosts))
        print(f"Replay: {html}")
        return 0
    print(f"Watch it at {meshcat.web_url()}; Ctrl-C ends it.")
    try:
        while True:
            time.sleep(1.0)
    except KeyboardInterrupt:
        return 0
