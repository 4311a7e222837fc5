"""Draws a course of square gates: from above, and how high it leads."""

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from airrace.track.geometry import directions
from airrace.track.square_gate import OUTER
from airrace.track.square_track import SquareTrack

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_GATE, _LEG, _START, _HALL = "#d9480f", "#4c6ef5", "#2b8a3e", "#868e96"


def draw_square_track(track: SquareTrack) -> Figure:
    """Returns a picture of a course: its plan above, the heights of its gates below."""
    figure = Figure(figsize=(9, 10), layout="constrained")
    plan, side = figure.subplots(2, 1, height_ratios=[4, 1])
    way = np.vstack([track.start.position, *(gate.p_WG for gate in track.gates)])
    lengths = np.linalg.norm(np.diff(way, axis=0), axis=1)
    _draw_plan(plan, track, way)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    side.plot(along, way[:, 2], color=_LEG, lw=1.2)
    for i, (x, z) in enumerate(zip(along[1:], way[1:, 2]), 1):
        side.plot([x, x], [z - OUTER / 2, z + OUTER / 2], color=_GATE, lw=3)
        side.annotate(str(i), (x, z + OUTER / 2), ha="center", va="bottom", color=_GATE)
    side.set(xlabel="along the course (m)", ylabel="height (m)", ylim=(0.0, None))
    side.grid(alpha=0.3)
    plan.set_title(f"{track.name}: {len(track.gates)} gates, {lengths.sum():.0f} m")
    return figure


def _draw_plan(axes: "Axes", track: SquareTrack, way: np.ndarray) -> None:
    axes.plot(*way[:, :2].T, color=_LEG, lw=1.2, ls=(0, (6, 4)), zorder=2)
    hall = track.hall()
    if hall is not None:
        size = hall.high - hall.low
        wall = Rectangle(tuple(hall.low[:2]), size[0], size[1], fill=False, edgecolor=_HALL, lw=2)
        axes.add_patch(wall)
        middles = np.array([box.X_WB.translation()[:2] for box in hall.columns]).reshape(-1, 2)
        axes.plot(*middles.T, "s", ms=4, color=_HALL)
    style: dict[str, Any] = dict(arrowstyle="-|>", lw=1.3)
    for i, gate in enumerate(track.gates, 1):
        axes.plot(*np.transpose([gate.p_WL[:2], gate.p_WR[:2]]), color=_GATE, lw=3, zorder=3)
        tip, foot = gate.p_WG[:2] + 2.5 * gate.forward[:2], gate.p_WG[:2]
        axes.annotate("", xy=tuple(tip), xytext=tuple(foot), arrowprops=style | {"color": _GATE})
        place = gate.p_WR[:2] + 1.2 * gate.rightward[:2]
        axes.annotate(str(i), tuple(place), ha="center", va="center", color=_GATE)
    p = np.array(track.start.position[:2])
    axes.plot(*p, "s", ms=8, color=_START, zorder=5)
    tip = p + 3.0 * directions(np.deg2rad(track.start.heading_deg))
    axes.annotate("", xy=tuple(tip), xytext=tuple(p), arrowprops=style | {"color": _START})
    axes.annotate("start", tuple(p), xytext=(0, -14), textcoords="offset points", color=_START)
    axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    axes.margins(0.05)
