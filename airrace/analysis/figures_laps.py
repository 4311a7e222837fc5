"""Pictures of laps side by side: along the lap, from gate to gate, and at the gates."""

from typing import TYPE_CHECKING

import numpy as np

from airrace.analysis.along_lap import LapProfile, best_lap, lap_profiles, leg_losses
from airrace.analysis.figure_style import (
    DESK,
    INK,
    MUTED,
    SHADE,
    Sheet,
    add_legend,
    add_tip,
    lap_style,
    make_figure,
)
from airrace.scenario.lap_limits import parse_limits

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from airrace.analysis.run import Run


def along_figure(run: "Run", sheet: Sheet = DESK) -> "Figure":
    """Returns speed, time behind the best lap, and height along all laps."""
    profiles, best = lap_profiles(run), best_lap(run) or 0
    compare = len(profiles) > 1
    heights = (2.2, 1.4, 1.0) if compare else (2.2, 1.0)
    figure = make_figure(sheet.width, 1.3 + 1.2 * sum(heights))
    panels = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights)
    speed, height = panels[0], panels[-1]
    for lap, profile in profiles.items():
        words = f"lap {lap}: {profile.time[-1]:.2f} s" + ", the best" * (lap == best)
        label = {best: f"lap {best}, the best"}.get(lap, "other laps")
        curves = [(speed, profile.speed), (height, profile.height)]
        if compare:
            curves.append((panels[1], profile.behind(profiles[best])))
        for axes, values in curves:
            (line,) = axes.plot(profile.place, values, label=label, **lap_style(lap, best))
            add_tip(line, words)
    _mark_gates(panels, profiles[best])
    max_speed, _ = parse_limits(run.result["limits"])
    if np.isfinite(max_speed):
        limit = dict(color=MUTED, lw=1.0, ls="--", label=f"limit, {max_speed:g} m/s")
        speed.axhline(max_speed, **limit)
    speed.set(ylabel="speed (m/s)", ylim=(0.0, None))
    height.set(ylabel="height (m)", xlabel="along the best lap (m)", ylim=(0.0, None))
    if compare:
        panels[1].axhline(0.0, color=INK, lw=0.8)
        panels[1].set(ylabel="behind the\nbest lap (s)")
    add_legend(figure, speed)
    return figure


def losses_figure(run: "Run", sheet: Sheet = DESK) -> "Figure":
    """Returns the time that each lap lost between two gates against the best lap."""
    losses = leg_losses(run)
    figure = make_figure(sheet.width, 3)
    axes = figure.add_subplot(xlabel="from gate to gate", ylabel="lost (s)")
    n = len(run.track.gates)
    for lap, seconds in losses.items():
        places = np.arange(1, n + 1) + _aside(lap, len(run.result["laps"]))
        (marks,) = axes.plot(places, seconds, "o", label="one lap", **lap_style(lap, None))
        add_tip(marks, f"lap {lap}: {seconds.sum():+.2f} s in all")
    middle = np.median([*losses.values()], axis=0)
    axes.hlines(middle, *_ends(n), color=INK, lw=1.6, label="median")
    axes.axhline(0.0, color=INK, lw=0.8)
    axes.set_xticks(range(1, n + 1), [f"{leg}–{leg % n + 1}" for leg in range(1, n + 1)])
    axes.tick_params(axis="x", rotation=0 if sheet.is_wide else 90)
    axes.grid(axis="x", visible=False)
    add_legend(figure, axes)
    return figure


def offsets_figure(run: "Run", sheet: Sheet = DESK) -> "Figure":
    """Returns how far from its midpoint each gate was crossed, lap by lap, and the pylons."""
    best, laps = best_lap(run), run.result["laps"]
    offsets = np.array([lap["gate_offsets_m"] for lap in laps])
    halves = np.array([gate.pylon_spacing / 2 for gate in run.track.gates])
    figure = make_figure(sheet.width, 3)
    axes = figure.add_subplot(xlabel="gate", ylabel="from the midpoint (m)")
    for lap, row in zip(laps, offsets):
        number = lap["lap"]
        label = f"lap {best}, the best" if number == best else "other laps"
        places = np.arange(1, len(row) + 1) + _aside(number, len(laps))
        (marks,) = axes.plot(places, row, "o", label=label, **lap_style(number, best))
        add_tip(marks, f"lap {number}: {row.max():.2f} m at most")
    axes.hlines(halves, *_ends(len(halves)), color=MUTED, lw=1.4, label="axes of the pylons")
    if offsets.max() < 0.1 * halves.min():
        # Millimetres and the pylons in one picture.
        axes.set(yscale="log", ylim=(min(1e-3, offsets[offsets > 0.0].min(initial=1.0)) / 2, 10.0))
    else:
        axes.set_ylim(0.0, 1.1 * halves.max())
    axes.set_xticks(range(1, len(halves) + 1))
    axes.grid(axis="x", visible=False)
    add_legend(figure, axes)
    return figure


def _aside(lap: int, laps: int) -> float:
    """Returns how far beside its place the mark of a lap is, so that all are seen."""
    return 0.6 * ((lap - 0.5) / laps - 0.5)


def _ends(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns where short lines at places 1 to n begin and end."""
    places = np.arange(1.0, n + 1)
    return places - 0.4, places + 0.4


def _mark_gates(panels: "Sequence[Axes]", profile: LapProfile) -> None:
    """Draws a line at every gate, with its number above the first panel."""
    for axes in panels:
        axes.grid(axis="x", visible=False)
        for place in profile.gates:
            axes.axvline(place, color=SHADE, lw=0.8, zorder=1)
        axes.margins(x=0.0)
    n = len(profile.gates) - 1
    above = panels[0].secondary_xaxis("top")
    above.set_xticks(profile.gates, [str(k % n + 1) for k in range(n + 1)])
    above.set_xlabel("gate")
    above.spines["top"].set_visible(False)
