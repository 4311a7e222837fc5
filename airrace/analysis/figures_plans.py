"""A picture of the planned laps, and of how the drone is to be turned along the last of them.

It is figure 11 of the Student AirRace paper, seen from above.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from airrace.analysis.figure_style import (
    DESK,
    INK,
    MUTED,
    SHADE,
    Sheet,
    add_legend,
    height_from_above,
    make_figure,
)
from airrace.common.colors import BEST, EARLIER
from airrace.track.plot import draw_gates
from airrace.trajopt.body_frames import body_frames
from airrace.trajopt.reference import Reference

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from airrace.analysis.run import Run

_NOSE, _THRUST = "#d62839", BEST
_MOST, _LEAST = 0.9, 0.15  # opacity of the newest and of the oldest of the laps before
_LEVEL, _TILTED = 2.2, 6.0  # m, length of a level nose and of a level thrust axis
_POINTS = ("x", "y", "z")


def planned_laps(run: "Run") -> dict[int, pd.DataFrame]:
    """Returns the circuits that were planned, by the first lap that was to fly them.

    Returns:
        {lap: rows of run.plan_samples}, in the order of the laps. The last is the plan in
        force at the end.
    """
    samples = run.plan_samples[run.plan_samples["part"] == "circuit"]
    # Over a link, a plan is recorded again and again.
    last = samples.groupby("lap")["plan"].max()
    return {int(lap): samples[samples["plan"] == last[lap]] for lap in last.index}


def flat_outputs(samples: pd.DataFrame) -> np.ndarray:
    """Returns the rows of a plan as samples of trajopt/reference.py, (18, N).

    The log has no accelerations; they are central differences of the velocities. What
    attitudes do not depend on is zero.
    """
    zero = np.zeros((3, len(samples)))
    velocity = samples[["vx", "vy", "vz"]].to_numpy().T
    acceleration = np.gradient(velocity, samples["time"].to_numpy(), axis=1)
    position, yaw = samples[[*_POINTS]].to_numpy().T, samples["yaw"].to_numpy()
    parts = (position, velocity, acceleration, zero, zero, yaw, *zero[:2])
    return np.vstack(Reference(*parts))


def plans_figure(run: "Run", sheet: Sheet = DESK) -> "Figure":
    """Returns the last plan from above with its body axes, and all before it in orange."""
    figure = make_figure(sheet.width, height_from_above(sheet, run.track.pylons()[:, :2]))
    axes = figure.add_subplot(aspect="equal", xlabel="x (m)", ylabel="y (m)")
    draw_gates(axes, run.track, INK, SHADE)
    *earlier, newest = planned_laps(run).values()
    for samples, opacity in zip(earlier, np.linspace(_LEAST, _MOST, len(earlier) + 1)[1:]):
        label = "plans before it" if samples is earlier[-1] else None
        axes.plot(*_closed(samples), color=EARLIER, lw=1.3, alpha=opacity, label=label, zorder=3)
    axes.plot(*_closed(newest), color=MUTED, lw=1.0, label="the last plan", zorder=4)
    position, x_axes, z_axes = body_frames(flat_outputs(newest))
    # Of the picture's width.
    line = 0.0144 / sheet.width
    arrows: dict[str, Any] = dict(angles="xy", scale_units="xy", width=line)
    axes.quiver(
        *position[:2],
        *z_axes[:2],
        color=_THRUST,
        label="thrust axis",
        scale=1 / _TILTED,
        headwidth=0.0,
        headlength=0.0,
        headaxislength=0.0,
        zorder=5,
        **arrows,
    )
    axes.quiver(
        *position[:2],
        *x_axes[:2],
        color=_NOSE,
        label="nose",
        scale=1 / _LEVEL,
        headwidth=4.5,
        zorder=6,
        **arrows,
    )
    add_legend(figure, axes, "outside upper center")
    axes.margins(0.05)
    return figure


def _closed(samples):
    """Returns x and y of a circuit (m), back to where it began."""
    x, y = samples[["x", "y"]].to_numpy().T
    return np.append(x, x[0]), np.append(y, y[0])
