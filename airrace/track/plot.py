"""Draws a course from above, and how high it leads."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Rectangle

from airrace.common.errors import UserError
from airrace.track.course import Course
from airrace.track.geometry import directions
from airrace.track.layout import Layout
from airrace.track.track import BOARD_SIZE, PYLON_BASE_RADIUS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_GRASS, _FLOOR, _GATE, _FRONT, _BACK = "#eef3e6", "#ffffff", "#d9480f", "#ffffff", "#212529"
_LEG, _START, _HALL = "#4c6ef5", "#2b8a3e", "#868e96"
_UNDATED = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}  # for equal files


def draw_track(track: Course) -> Figure:
    """Returns a picture of a course: gates, numbers, boards, the way through them and the start.

    If the gates are not all equally high, their heights are below it. A legend beside it says what
    the marks are: of the stripes on pylons, boards on the front are white, on the back black.
    """
    way = track.way()
    length = np.linalg.norm(np.diff(way, axis=0), axis=1).sum()
    level = np.ptp([gate.p_WG[2] for gate in track.gates]) == 0.0
    ratios = [1] if level else [4, 1]
    figure = Figure(figsize=(9, 9 if level else 10), layout="constrained")
    axes, *below = figure.subplots(len(ratios), 1, height_ratios=ratios, squeeze=False)[:, 0]
    hall = track.hall()
    axes.set(aspect="equal", facecolor=_GRASS if hall is None else _FLOOR)
    if hall is not None:
        _draw_hall(axes, hall)
    for p, q in zip(way[:-1, :2], way[1:, :2]):
        axes.plot(*np.transpose([p, q]), color=_LEG, lw=1.2, ls=(0, (6, 4)), zorder=2)
        _draw_arrow(axes, p + 0.5 * (q - p), 0.08 * (q - p), _LEG)
    draw_gates(axes, track, _GATE, _GATE)
    for board in track.boards():
        across = BOARD_SIZE / 2 * board.X_WM.rotation().col(0)[:2]
        ends = board.X_WM.translation()[:2] + np.outer([-1, 1], across)
        axes.plot(*ends.T, color=_BACK if board.id % 2 else _FRONT, lw=2, zorder=4)
    _draw_start(axes, track)
    title = f"{track.name}: {len(track.gates)} gates, {length:.0f} m"
    if track.closed:
        turns = Layout.of(track).turns.sum()
        title += ", counter-clockwise" if turns > 0 else ", clockwise"
    axes.set_title(title)
    axes.set(xlabel="x (m)", ylabel="y (m)")
    axes.margins(0.08)
    axes.grid(color="white", zorder=0)
    axes.set_axisbelow(True)
    for side in below:
        _draw_heights(side, track)
    _add_legend(figure, track)
    return figure


def save_plot(track: Course, path: Path) -> None:
    """Writes the picture of a track; the file's ending says in which format.

    Raises UserError if the file cannot be written or has an ending of no picture.
    """
    figure = draw_track(track)
    ending = path.suffix.lstrip(".").lower()
    if ending not in FigureCanvasAgg(figure).get_supported_filetypes():
        raise UserError(f"--plot {path} has no ending of a picture; give a .png, .svg or .pdf.")
    try:
        with rc_context({"svg.hashsalt": "airrace"}):
            figure.savefig(path, dpi=120, metadata=_UNDATED.get(ending))
    except OSError as e:
        raise UserError(
            f"--plot {path} cannot be written ({e.strerror}); name another file."
        ) from None


def draw_gates(axes: "Axes", track: Course, color: str, foot: str) -> None:
    """Draws all gates with their numbers and directions; foot: the colour in pylons."""
    layout, size = Layout.of(track), _size(track)
    for p in track.pylons()[:, :2]:
        circle = Circle(p, PYLON_BASE_RADIUS, facecolor=foot, edgecolor=color, lw=0.7, zorder=3)
        axes.add_patch(circle)
    style: dict = dict(lw=3) if track.frames() else dict(lw=0.8, alpha=0.6)
    for n, (left, right) in enumerate(layout.pylons):
        axes.plot(*np.transpose([left, right]), color=color, zorder=2, **style)
        _draw_arrow(axes, layout.middle[n], 0.5 * size * layout.forward[n], color)
        # Beside the right side, away from the gate.
        p = right + 0.17 * size * layout.rightward[n]
        _draw_text(axes, str(n + 1), p, 12 * layout.rightward[n], color, fontweight="bold")


def _size(track):
    """Returns how large marks are that go with the gates (m)."""
    return max(track.gates[0].width, 5.0)


def _draw_hall(axes, hall):
    size = hall.high - hall.low
    wall = Rectangle(tuple(hall.low[:2]), size[0], size[1], fill=False, edgecolor=_HALL, lw=2)
    axes.add_patch(wall)
    middles = np.array([box.X_WB.translation()[:2] for box in hall.columns]).reshape(-1, 2)
    axes.plot(*middles.T, "s", ms=4, color=_HALL)


def _draw_heights(axes, track):
    """Draws the frames of gates, and the way through them, from the side."""
    way = track.way()
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1)))
    axes.plot(along, way[:, 2], color=_LEG, lw=1.2)
    for n, (gate, x) in enumerate(zip(track.gates, along[1:]), 1):
        z, half = gate.p_WG[2], gate.height / 2
        axes.plot([x, x], [z - half, z + half], color=_GATE, lw=3)
        axes.annotate(str(n), (x, z + half), ha="center", va="bottom", color=_GATE)
    axes.set(xlabel="along the course (m)", ylabel="height (m)", ylim=(0.0, None))
    axes.grid(alpha=0.3)


def _add_legend(figure, track):
    """Adds what the marks are, below the picture."""
    pylons = [
        Line2D([], [], color=_GATE, marker="o", ls="none", ms=8, label="pylon"),
        Line2D([], [], color=_FRONT, lw=3, label="board on the front, even markers"),
        Line2D([], [], color=_BACK, lw=3, label="board on the back, odd markers"),
    ]
    handles = [
        *(pylons if track.has_markers else [Line2D([], [], color=_GATE, lw=3, label="gate")]),
        Line2D([], [], color=_LEG, lw=1.2, ls=(0, (6, 4)), label="way from gate to gate"),
        Line2D([], [], color=_START, marker="s", ls="none", ms=8, label="start"),
    ]
    # White boards are seen on what they are drawn on.
    figure.legend(
        handles=handles, loc="outside lower center", ncols=3, facecolor=_GRASS, framealpha=1.0
    )


def _draw_start(axes, track):
    p = np.array(track.start.position[:2])
    forward = directions(np.deg2rad(track.start.heading_deg))
    axes.plot(*p, "s", ms=8, color=_START, zorder=5)
    _draw_arrow(axes, p, 0.8 * _size(track) * forward, _START)
    _draw_text(axes, "start", p, [-22, -13] * forward, _START)


def _draw_arrow(axes, p, direction, color):
    style = dict(arrowstyle="-|>", color=color, lw=1.3)
    axes.annotate("", xy=p + direction, xytext=p, arrowprops=style, zorder=5)


def _draw_text(axes, text, p, offset, color, **options):
    """Writes a text beside a point; the offset is in typographic points."""
    options |= dict(color=color, ha="center", va="center", textcoords="offset points", zorder=5)
    axes.annotate(text, p, xytext=offset, **options)
