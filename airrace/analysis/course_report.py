"""report.html of a flight that a client flew through a course of square gates."""

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from airrace.analysis.log import read_attachments
from airrace.analysis.page_templates import page_template
from airrace.analysis.signals import read_signals
from airrace.common.errors import UserError
from airrace.common.resources import load_yaml
from airrace.recording.race_json import read_course_json
from airrace.recording.writer import FILE as LOG
from airrace.track import Course
from airrace.track.course import Opening
from airrace.track.square_gate import OUTER
from airrace.track.square_track import SquareTrack
from airrace.track.track_files import checked_track

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

_PAGE = "course_report.html"


class Passage(NamedTuple):
    """How the drone crossed the plane of a gate; NaN, and words, if it never did."""

    gate: int  #: from 1
    counted: bool  #: whether the referee counted it
    time: float  #: (s)
    right: float  #: from the middle of the opening, as its viewer in front sees it (m)
    up: float  #: (m)
    speed: float  #: (m/s)
    what: str  #: in words


def make_course_report(folder: Path) -> str:
    """Returns the report of a client's flight, a page that needs nothing else.

    Args: folder: of the run.

    Raises UserError if it was not recorded, or something of it cannot be read.
    """
    from airrace.analysis.figure_style import Sheet, inline_pictures

    result = read_course_json(folder / "race.json")
    log = folder / LOG
    if not log.exists():
        raise UserError(f"{folder} holds no {LOG}: fly with --record light or full.")
    data = read_attachments(log)["track.yaml"]
    track = checked_track(load_yaml(SquareTrack, data=data, what="the track"), f"in {log}")
    state = read_signals(log)["state"]
    path = _flown(state, result["start_s"])
    gates = passages(track, path, result["gates_passed"])
    title = "The course from above, and heights over time"

    def draw(sheet: Sheet) -> "Figure":
        return course_figure(track, path, gates, sheet.width)

    return page_template("airrace.analysis", _PAGE).render(
        result=result,
        folder=folder.resolve().name,
        gates=gates,
        pictures={title: inline_pictures(draw, title)},
    )


def _flown(state: "pd.DataFrame", start: float | None) -> np.ndarray:
    """Returns rows of time, position and velocity since the start, (n, 7)."""
    path = state[["time", "x", "y", "z", "vx", "vy", "vz"]].to_numpy(float)
    return path[path[:, 0] >= (start or 0.0)]


def passages(track: Course, path: np.ndarray, counted: int) -> list[Passage]:
    """Returns how the drone came to each gate, in their order.

    Args:
        track: with the gates.
        path: rows of time, position and velocity, (n, 7).
        counted: how many gates the referee counted; of the others, the nearest crossing of their
            planes is told, whenever it was, or if there is none, how near the drone came.
    """
    found, since = [], -np.inf
    for i, gate in enumerate(track.gates):
        passage = _passage(i + 1, gate.opening(), path[path[:, 0] >= since], i < counted)
        since = passage.time if i < counted else since
        found.append(passage)
    return found


def _passage(number: int, opening: Opening, path: np.ndarray, counted: bool) -> Passage:
    axes = np.array([opening.forward, opening.rightward, opening.up])
    offsets = (path[:, 1:4] - opening.middle) @ axes.T
    speeds = np.linalg.norm(path[:, 4:], axis=1)
    if not len(path):
        return Passage(number, False, np.nan, np.nan, np.nan, np.nan, "never flown to")
    crossed = np.flatnonzero((offsets[:-1, 0] < 0.0) & (offsets[1:, 0] >= 0.0))
    if len(crossed) == 0:
        distances = np.linalg.norm(offsets, axis=1)
        i = int(distances.argmin())
        what = f"not reached: {distances[i]:.1f} m off at best, at {path[i, 0]:.1f} s"
        return Passage(number, False, np.nan, np.nan, np.nan, np.nan, what)
    before, after = offsets[crossed], offsets[crossed + 1]
    shares = before[:, 0] / (before[:, 0] - after[:, 0])
    places = (before + shares[:, None] * (after - before))[:, 1:]
    # The first way through counts; of those beside it, the nearest is told.
    k = 0 if counted else int(np.linalg.norm(places, axis=1).argmin())
    right, up = places[k]
    i = int(crossed[k])
    time = path[i, 0] + shares[k] * (path[i + 1, 0] - path[i, 0])
    what = "passed" if counted else f"missed: {_where(right, up, opening)}"
    return Passage(number, counted, float(time), float(right), float(up), float(speeds[i]), what)


def _where(right: float, up: float, opening: Opening) -> str:
    """Returns in words where a point is, beside an opening."""
    inside = abs(right) < opening.half_width and opening.low < up < opening.high
    if inside:
        return "through the opening, out of order or from behind"
    words = []
    if abs(up) > opening.high:
        words.append(f"{abs(up) - opening.high:.2f} m {'above' if up > 0 else 'below'}")
    if abs(right) > opening.half_width:
        aside = abs(right) - opening.half_width
        words.append(f"{aside:.2f} m to the {'right' if right > 0 else 'left'}")
    frame = max(abs(right), abs(up)) < OUTER / 2
    of = " of" if abs(right) > opening.half_width else ""
    return " and ".join(words) + f"{of} the opening" + (", on the frame" if frame else "")


def course_figure(
    track: Course, path: np.ndarray, gates: list[Passage], width: float = 9.0
) -> "Figure":
    """Returns the course from above with the flown path, and heights over time; width: (inches)."""
    from airrace.analysis.figure_style import FAINT, INK, make_figure
    from airrace.track.plot import draw_gates

    gates_at = [gate.p_WG[:2] for gate in track.gates]
    reach = np.ptp(np.vstack([path[:, 1:3], gates_at, track.start.position[:2]]), axis=0) + OUTER
    plan_height = np.clip(width * reach[1] / reach[0], 1.5, width)
    figure = make_figure(width, plan_height + 2.5)
    plan, side = figure.subplots(2, 1, height_ratios=[plan_height, 2.0])
    plan.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")
    draw_gates(plan, track, FAINT, FAINT)
    plan.plot(path[:, 1], path[:, 2], color=INK, lw=1.4)
    plan.plot(*track.start.position[:2], "s", color=INK, ms=5)
    if len(path):
        plan.plot(*path[-1, 1:3], "X", color=INK, ms=9)
    side.plot(path[:, 0], path[:, 3], color=INK, lw=1.2)
    for passage, gate in zip(gates, track.gates):
        if np.isfinite(passage.time):
            ends = gate.p_WG[2] + OUTER / 2 * np.array([-1.0, 1.0])
            side.plot([passage.time] * 2, ends, color=FAINT, lw=3)
            side.annotate(str(passage.gate), (passage.time, ends[1]), ha="center", color=INK)
    side.set(xlabel="time (s)", ylabel="height (m)", ylim=(0.0, None))
    return figure
