"""A picture of where a race was flown."""

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.collections import LineCollection

from airrace.analysis.figure_style import (
    DESK,
    FAINT,
    INK,
    SHADE,
    SPEED_COLORS,
    Sheet,
    add_colorbar,
    add_legend,
    height_from_above,
    make_figure,
)
from airrace.scenario.lap_limits import speed_scale_end
from airrace.track.plot import draw_gates

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from airrace.analysis.run import Run

_STEP = 2.5  # m of a piece of a lap, which has one colour


def track_figure(run: "Run", sheet: Sheet = DESK) -> "Figure":
    """Returns the track from above with the flown laps, coloured by speed."""
    figure = make_figure(sheet.width, height_from_above(sheet, run.track.pylons()[:, :2]))
    axes = figure.add_subplot(aspect="equal", xlabel="x (m)", ylabel="y (m)")
    laps = {lap: _thinned(state) for lap, state in run.state.groupby("lap")}
    exploring = laps.get(0, run.state)
    dashed: dict[str, Any] = dict(color=FAINT, lw=0.9, ls=(0, (4, 3)), label="exploring", zorder=1)
    axes.plot(exploring["x"], exploring["y"], **dashed)
    raced = [state for lap, state in laps.items() if 0 < lap <= max(run.scenario.laps, 1)]  # type: ignore[operator]
    if raced:
        paths = [state[["x", "y"]].to_numpy() for state in raced]
        pieces = [piece for path in paths for piece in zip(path, path[1:])]
        lines = LineCollection(pieces, cmap=SPEED_COLORS, lw=1.6, zorder=3)
        lines.set_array(np.concatenate([state["speed"][:-1] for state in raced]))
        lines.set_clim(0.0, speed_scale_end(run.result["limits"]))
        axes.add_collection(lines)
        place = "right" if sheet.is_wide else "bottom"
        add_colorbar(figure, lines, axes, "speed (m/s)", location=place, shrink=0.75, pad=0.02)
    draw_gates(axes, run.track, INK, SHADE)
    start = run.track.start.position
    axes.plot(*start[:2], "s", color=INK, ms=5, zorder=4, label="start")
    if not run.result["finished"] and len(run.state):
        axes.plot(*run.state[["x", "y"]].iloc[-1], "X", color=INK, ms=10, zorder=6, label="the end")
    add_legend(figure, axes, "outside upper center")
    axes.margins(0.05)
    return figure


def _thinned(state):
    """Returns the rows of a table of states that are about _STEP of path apart."""
    path = np.hypot(state["x"].diff(), state["y"].diff()).fillna(0.0).cumsum().to_numpy()
    rows = np.searchsorted(path, np.arange(0.0, path[-1] + _STEP, _STEP))
    return state.iloc[np.unique(rows.clip(max=len(path) - 1))]
