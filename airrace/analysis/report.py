"""report.html of a run: python -m airrace.analysis.report RUN."""

import argparse
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from airrace.analysis.run import Run
from airrace.common.errors import exit_code
from airrace.common.files import write_text
from airrace.recording.race_result import ORIGINAL_LAPS, ORIGINAL_TRACK
from airrace.scenario import trajectory_name

FILE = "report.html"
# Topics that it says nothing of.
_WITHOUT = (
    "/state/estimate",
    "/state/filtered",
    "/state/disturbance",
    "/detections",
    "/rotors/command",
)


class _Figure(NamedTuple):
    """A section with a picture."""

    title: str
    svg: str
    caption: str


def make_report(run: Run) -> str:
    """Returns the report of a run, a page that needs nothing else."""
    from jinja2 import Environment, PackageLoader

    templates = Environment(
        loader=PackageLoader("airrace.analysis"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    result = run.result
    return templates.get_template(FILE).render(
        run=run,
        result=result,
        trajectory=trajectory_name(result["trajectory"]),
        facts=_facts(run),
        splits=np.array([np.diff([*lap["gate_times_s"], lap["time_s"]]) for lap in result["laps"]]),
        original=ORIGINAL_LAPS if result["track"] == ORIGINAL_TRACK else {},
        figures=_figures(run),
    )


def _facts(run) -> list[tuple]:
    """Returns the most important numbers, each with its name before it."""
    from airrace.analysis.figures_signals import rotor_usage

    result, exploration = run.result, run.result["exploration"]
    laps, facts = result["laps"], []
    if laps:
        facts += [
            ("best lap", f"{result['best_lap_s']:.2f} s"),
            ("mean lap", f"{result['mean_lap_s']:.2f} s"),
            ("top speed", f"{max(lap['max_speed'] for lap in laps):.1f} m/s"),
        ]
    facts.append(("exploration", f"{exploration['time_s']:.1f} s"))
    facts.append(("gates found", exploration["gates_found"]))
    rms = run.laps["map_rms"].dropna()
    if len(rms):
        facts.append(("map error at the end", f"{100 * rms.iloc[-1]:.1f} cm"))
    off = run.tracking["distance"][run.tracking["lap"].between(1, len(laps))]
    if len(off):
        facts.append(("tracking error", f"{100 * np.sqrt(np.mean(off**2)):.1f} cm"))
    usage = [share.max() for share in rotor_usage(run) if len(share)]
    if usage:
        facts.append(("most of a rotor's thrust", f"{100 * max(usage):.0f} %"))
    return facts


def _figures(run) -> list[_Figure]:
    """Returns the sections with a picture that this run has data for."""
    from matplotlib import rc_context

    from airrace.analysis import figures_laps, figures_signals, figures_track
    from airrace.analysis.figure_style import STYLE, inline_svg

    laps = run.result["laps"]
    recorded = len(run.state) > 1
    figures = []

    def add(title, wanted, draw, caption):
        if wanted:
            figures.append(_Figure(title, inline_svg(draw(run), title), caption))

    with rc_context(STYLE):
        add(
            "The track from above",
            True,
            figures_track.track_figure,
            "All laps in one picture: the darker, the faster. Dashed: the exploration."
            if recorded
            else "The gates; where the drone flew was not recorded.",
        )
        add(
            "Where time was lost",
            bool(figures_laps.time_lost(run)),
            figures_laps.time_lost_figure,
            "Flown minus planned time, at every gate; above zero, the drone is late. A lap counts "
            "from the first gate at which the drone is on its plan's circuit.",
        )
        add(
            "Gates",
            bool(laps),
            figures_track.offsets_figure,
            "How far from the middle of each gate the drone crossed it.",
        )
        add(
            "The map",
            len(run.map) > 0 and len(run.lap_starts) > 0,
            figures_signals.map_figure,
            "Distance of mapped markers from where they stood when the race began. Even numbers "
            "are on the front.",
        )
        add(
            "Tracking",
            recorded and len(run.tracking) > 1,
            figures_signals.tracking_figure,
            "Distance of the true position from the controller's reference. Dotted: gate 1.",
        )
        add(
            "Rotors",
            len(run.rotors) > 0,
            figures_signals.rotors_figure,
            "Thrust against the limit while racing: quartiles, 1 and 99 % of the time, and the "
            "most; and for how much of the time all rotors together were above some thrust.",
        )
        add(
            "What the explorer did",
            bool(run.result["exploration"]["events"]),
            figures_laps.timeline_figure,
            "Its states from take-off to the first lap.",
        )
    return figures


def write_report(folder) -> Path:
    """Writes report.html of a run, which may be unfinished; returns its path.

    Args:
        folder: of the run.

    Raises:
        UserError: if it holds no race, or the file cannot be written.
    """
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
