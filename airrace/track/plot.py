"""Draws a track from above."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from airrace.common.errors import UserError
from airrace.track.geometry import directions
from airrace.track.layout import Layout
from airrace.track.square_plot import draw_square_track
from airrace.track.square_track import AnyTrack, SquareTrack
from airrace.track.track import BOARD_SIZE, PYLON_BASE_RADIUS, Track

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_GRASS, _PYLON, _FRONT, _BACK = "#eef3e6", "#d9480f", "#ffffff", "#212529"
_LEG, _START = "#4c6ef5", "#2b8a3e"
_UNDATED = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}  # for equal files


def draw_track(track: Track) -> Figure:
    """Returns a picture of a track: pylons, boards, numbers, legs and the start.

    A legend beside it says what the stripes are: the boards, front ones white, back ones black.
    """
    layout = Layout.of(track)
    figure = Figure(figsize=(9, 9), layout="constrained")
    axes = figure.add_subplot(aspect="equal", facecolor=_GRASS)
    _draw_legs(axes, layout)
    draw_gates(axes, layout, _PYLON, _PYLON)
    _draw_boards(axes, track)
    _draw_start(axes, track.start)
    length = np.linalg.norm(np.roll(layout.middle, -1, axis=0) - layout.middle, axis=1).sum()
    direction = "counter-clockwise" if layout.turns.sum() > 0 else "clockwise"
    axes.set_title(f"{track.name}: {len(track.gates)} gates, {length:.0f} m, {direction}")
    axes.set(xlabel="x (m)", ylabel="y (m)")
    axes.margins(0.08)
    axes.grid(color="white", zorder=0)
    axes.set_axisbelow(True)
    _add_legend(figure)
    return figure


def save_plot(track: AnyTrack, path: Path) -> None:
    """Writes the picture of a track; the file's ending says in which format.

    Raises:
        UserError: if the file cannot be written or has an ending of no picture.
    """
    if isinstance(track, SquareTrack):
        figure = draw_square_track(track)
    else:
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


def draw_gates(axes: "Axes", layout: Layout, color: str, foot: str) -> None:
    """Draws all gates of a layout with their numbers and directions.

    Args:
        axes: Matplotlib's.
        layout: the track.
        color: of lines, arrows and numbers.
        foot: colour that pylons are filled with.
    """
    for n, (left, right) in enumerate(layout.pylons):
        axes.plot(*np.transpose([left, right]), color=color, lw=0.8, alpha=0.6, zorder=2)
        for p in (left, right):
            circle = Circle(p, PYLON_BASE_RADIUS, facecolor=foot, edgecolor=color, lw=0.7, zorder=3)
            axes.add_patch(circle)
        _draw_arrow(axes, layout.middle[n], 5 * layout.forward[n], color)
        # Beside the right pylon, away from the gate.
        p = right + PYLON_BASE_RADIUS * layout.rightward[n]
        _draw_text(axes, str(n + 1), p, 12 * layout.rightward[n], color, fontweight="bold")


def _draw_boards(axes, track):
    for board in track.boards():
        across = BOARD_SIZE / 2 * board.X_WM.rotation().col(0)[:2]
        ends = board.X_WM.translation()[:2] + np.outer([-1, 1], across)
        axes.plot(*ends.T, color=_BACK if board.id % 2 else _FRONT, lw=2, zorder=4)


def _add_legend(figure):
    """Adds what the marks are, below the picture."""
    handles = [
        Line2D([], [], color=_PYLON, marker="o", ls="none", ms=8, label="pylon"),
        Line2D([], [], color=_FRONT, lw=3, label="board on the front, even markers"),
        Line2D([], [], color=_BACK, lw=3, label="board on the back, odd markers"),
        Line2D([], [], color=_LEG, lw=1.2, ls=(0, (6, 4)), label="way from gate to gate"),
        Line2D([], [], color=_START, marker="s", ls="none", ms=8, label="start"),
    ]
    # White boards are seen on what they are drawn on.
    figure.legend(
        handles=handles, loc="outside lower center", ncols=3, facecolor=_GRASS, framealpha=1.0
    )


def _draw_legs(axes, layout):
    for p, q in zip(layout.middle, np.roll(layout.middle, -1, axis=0)):
        axes.plot(*np.transpose([p, q]), color=_LEG, lw=1.2, ls=(0, (6, 4)), zorder=2)
        _draw_arrow(axes, p + 0.5 * (q - p), 0.08 * (q - p), _LEG)


def _draw_start(axes, start):
    p = np.array(start.position[:2])
    forward = directions(np.deg2rad(start.heading_deg))
    axes.plot(*p, "s", ms=8, color=_START, zorder=5)
    _draw_arrow(axes, p, 8 * forward, _START)
    _draw_text(axes, "start", p, [-22, -13] * forward, _START)


def _draw_arrow(axes, p, direction, color):
    style = dict(arrowstyle="-|>", color=color, lw=1.3)
    axes.annotate("", xy=p + direction, xytext=p, arrowprops=style, zorder=5)


def _draw_text(axes, text, p, offset, color, **options):
    """Writes a text beside a point; the offset is in typographic points."""
    options |= dict(color=color, ha="center", va="center", textcoords="offset points", zorder=5)
    axes.annotate(text, p, xytext=offset, **options)
