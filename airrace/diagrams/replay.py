"""Shows flown runs again: python -m airrace.diagrams.replay RUN [RUN2 ...]."""

import argparse
import sys
import time
from pathlib import Path

from airrace.common.errors import exit_code

EPILOG = """\
examples:
  python -m airrace.diagrams.replay runs/NAME               in a browser, with controls
  python -m airrace.diagrams.replay runs/A runs/B           both together, from the start
  python -m airrace.diagrams.replay runs/A runs/B --align lap --lap 2
                                                            both cross gate 1 at once
  python -m airrace.diagrams.replay runs/A --html a.html    a page that opens offline

The page's controls, top right, play, pause, and go to any time: Animations > default.
"""


def make_parser() -> argparse.ArgumentParser:
    """Returns the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="airrace.diagrams.replay",
        epilog=EPILOG,
        description="Show one or several runs of a track again, together, from their race.mcap.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "runs", metavar="RUN", nargs="+", type=Path, help="the folder that a race left"
    )
    parser.add_argument(
        "--align",
        choices=("start", "lap"),
        default="start",
        help="what happens at the same time in all: power on, or gate 1 at the "
        "beginning of --lap (default: start)",
    )
    parser.add_argument(
        "--lap", type=int, metavar="K", help="the lap that --align lap begins with (default: 1)"
    )
    parser.add_argument(
        "--html", metavar="FILE", type=Path, help="write a page that opens offline, and exit"
    )
    return parser


def run(args) -> int:
    """Shows the runs of parsed arguments; returns the exit code."""
    from rich.console import Console

    from airrace.analysis.run import load_run
    from airrace.common.errors import UserError
    from airrace.common.files import write_text
    from airrace.visualization.ghosts import make_ghosts, show_ghosts, with_legend
    from airrace.visualization.meshcat_page import MakeMeshcat

    if args.lap is not None and args.align != "lap":
        raise UserError("--lap needs --align lap.")
    lap = 1 if args.lap is None else args.lap
    with Console(stderr=True).status("Reading ...") as status:
        ghosts = make_ghosts([load_run(folder) for folder in args.runs], args.align, lap)
        status.update("Drawing ...")
        meshcat = MakeMeshcat(ghosts[0].run.track)
        show_ghosts(meshcat, ghosts)
    for ghost in ghosts:
        name = ghost.color if len(ghosts) > 1 else "the drone"
        print(f"{name}: {ghost.run.folder}")
    if args.html is not None:
        write_text(args.html, with_legend(meshcat.StaticHtml(), ghosts))
        print(f"Replay: {args.html}")
        return 0
    print(f"Watch it at {meshcat.web_url()}; Ctrl-C ends it.")
    try:
        while True:
            time.sleep(1.0)
    except KeyboardInterrupt:
        return 0


def main(argv=None) -> int:
    """The command-line program; returns its exit code."""
    return exit_code(lambda: run(make_parser().parse_args(argv)))


if __name__ == "__main__":
    sys.exit(main())
