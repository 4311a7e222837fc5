"""report.html of a run: python -m airrace.analysis.report RUN."""

import argparse
import sys
from pathlib import Path

from airrace.common.errors import exit_code

FILE = "report.html"
# Topics that it says nothing of.
_WITHOUT = (
    "/state/estimate",
    "/state/filtered",
    "/state/disturbance",
    "/detections",
    "/rotors/command",
)


def make_report(run) -> str:
    """Returns the report of a Run, a page that needs nothing else."""
    from matplotlib import rc_context

    from airrace.analysis import html
    from airrace.analysis.report_head import head, lap_table
    from airrace.analysis.svg import STYLE

    body = head(run)
    if run.result["laps"]:
        body += [html.heading("Laps"), lap_table(run)]
    with rc_context(STYLE):
        body += _figures(run)
    return html.page(f"{run.result['track']}, {run.result['drone']}", body)


def _figures(run) -> list:
    """Returns the sections with a picture that this run has data for."""
    from airrace.analysis import figures_laps, figures_signals, figures_track, html
    from airrace.analysis.svg import inline_svg

    laps, columns = run.result["laps"], run.columns
    recorded = len(columns["state"]["time"]) > 1
    parts = []

    def add(name, title, wanted, draw, caption):
        if wanted:
            svg = inline_svg(draw(run), name, f"{title}. {caption}")
            parts.extend([html.heading(title), html.figure(svg, caption)])

    add(
        "track",
        "The track from above",
        True,
        figures_track.track_figure,
        "All laps in one picture: the darker, the faster. Dashed: the exploration."
        if recorded
        else "The gates; where the drone flew was not recorded.",
    )
    add(
        "lost",
        "Where time was lost",
        bool(figures_laps.time_lost(run)),
        figures_laps.time_lost_figure,
        "Flown minus planned time, at every gate; above zero, the drone is late. A lap counts "
        "from the first gate at which the drone is on its plan's circuit.",
    )
    add(
        "offsets",
        "Gates",
        bool(laps),
        figures_track.offsets_figure,
        "How far from the middle of each gate the drone crossed it.",
    )
    add(
        "map",
        "The map",
        len(columns["map"]["time"]) > 0 and len(run.lap_starts) > 0,
        figures_signals.map_figure,
        "Distance of mapped markers from where they stood when the race began. Even numbers are "
        "on the front.",
    )
    add(
        "tracking",
        "Tracking",
        recorded and len(columns["tracking"]["time"]) > 1,
        figures_signals.tracking_figure,
        "Distance of the true position from the controller's reference. Dotted: gate 1.",
    )
    add(
        "rotors",
        "Rotors",
        len(columns["rotors"]["time"]) > 0,
        figures_signals.rotors_figure,
        "Thrust against the limit while racing: quartiles, 1 and 99 % of the time, and the most; "
        "and for how much of the time all rotors together were above some thrust.",
    )
    add(
        "explorer",
        "What the explorer did",
        bool(run.result["exploration"]["events"]),
        figures_laps.timeline_figure,
        "Its states from take-off to the first lap.",
    )
    return parts


def write_report(folder) -> Path:
    """Writes report.html of a run, which may be unfinished; returns its path.

    Args:
        folder: of the run.

    Raises:
        UserError: if it holds no race, or the file cannot be written.
    """
    from airrace.analysis.run import Run
    from airrace.common.files import write_text

    run = Run(folder, without=_WITHOUT)
    path = run.folder / FILE
    write_text(path, make_report(run))
    return path


def main(argv=None) -> int:
    """The command-line program; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="airrace.analysis.report",
        description="Write report.html of a run, a page that needs nothing else; every race "
        "writes it when it ends.",
        epilog="example: python -m airrace.analysis.report runs/NAME",
    )
    parser.add_argument("run", metavar="RUN", type=Path, help="the folder that a race left")
    args = parser.parse_args(argv)

    def run():
        print(f"Report: {write_report(args.run)}")
        return 0

    return exit_code(run)


if __name__ == "__main__":
    sys.exit(main())
