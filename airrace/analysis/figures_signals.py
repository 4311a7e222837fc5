"""Pictures of the map, of tracking, and of the rotors."""

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from matplotlib.ticker import MaxNLocator

from airrace.analysis.figure_style import GREYS, INK, RMS, WORST, add_colorbar, make_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from airrace.analysis.run import Run

_BINS = 400  # of a line over time, each with its greatest value


def map_by_lap(run: "Run") -> pd.DataFrame:
    """Returns the map's errors (m): a row a marker, a column a lap; 0 is the exploration."""
    times = np.unique(run.map["time"])
    # The map is written just after gate 1 is crossed.
    at = np.searchsorted(times, run.lap_starts).clip(max=len(times) - 1)
    errors = run.map.pivot(index="marker", columns="time", values="error")[times[at]]
    return errors.set_axis(range(len(at)), axis="columns").dropna(how="all")


def map_figure(run: "Run") -> "Figure":
    """Returns the error of every marker in the map after the exploration and each lap."""
    errors = 100 * map_by_lap(run)
    markers, laps = errors.index, errors.columns
    figure = make_figure(9, 3.8)
    left, right = figure.subplots(1, 2, width_ratios=(1, 2.4))
    left.set(xlabel="after lap (0: exploring)", ylabel="front markers' error (cm)")
    front = errors[markers % 2 == 0]
    if len(front):
        left.plot(laps, front.max(), **WORST)
        left.plot(laps, np.sqrt((front**2).mean()), **RMS)
        left.legend()
    left.set_ylim(bottom=0.0)
    left.xaxis.set_major_locator(MaxNLocator(integer=True))
    right.grid(False)
    if len(markers):
        cells = right.pcolormesh(
            laps,
            range(len(markers)),
            errors,
            cmap=GREYS,
            vmin=0.0,
            shading="nearest",
            edgecolor="face",
            lw=0.2,
        )
        add_colorbar(figure, cells, right, "error (cm)")
        step = max(1, len(markers) // 16)
        right.set_yticks(range(0, len(markers), step), markers[::step])
    right.set(xlabel="after lap", ylabel="marker")
    right.set_xticks(laps)
    return figure


def tracking_figure(run: "Run") -> "Figure":
    """Returns how far the drone was from its reference, over time and lap by lap."""
    time, lap, off = run.tracking["time"], run.tracking["lap"], 100 * run.tracking["distance"]
    figure = make_figure(9, 3)
    left, right = figure.subplots(1, 2, width_ratios=(2.4, 1))
    left.set(xlabel="time (s)", ylabel="off the reference (cm)", yscale="log")
    bins = np.arange(len(time)) * min(_BINS, len(time)) // len(time)
    worst = off.groupby(bins).max().clip(lower=0.01)
    left.plot(time.groupby(bins).first(), worst, color=INK, lw=0.8)
    for start in run.lap_starts:
        left.axvline(start, color="#999", lw=0.6, ls=":")
    flown = lap.between(1, len(run.result["laps"]))
    worst = off[flown].groupby(lap[flown]).max()
    right.plot(worst.index, worst, **WORST)
    right.plot(worst.index, np.sqrt((off[flown] ** 2).groupby(lap[flown]).mean()), **RMS)
    right.set(xlabel="lap", ylabel="(cm)")
    right.set_ylim(bottom=0.0)
    right.xaxis.set_major_locator(MaxNLocator(integer=True))
    if len(worst):
        right.legend()
    return figure


def rotor_usage(run: "Run") -> list:
    """Returns the thrust of each rotor while racing, as shares of its limit, 0 to 1."""
    rotors = run.rotors[run.rotors["lap"].between(1, run.scenario.laps)]
    if rotors.empty:
        rotors = run.rotors
    return [
        (rotors["thrust"][rotors["rotor"] == number] / limit).to_numpy()
        for number, limit in enumerate(run.vehicle.max_thrusts.tolist(), 1)
    ]


def rotors_figure(run: "Run") -> "Figure":
    """Returns how much of its thrust each rotor used."""
    usage = [100 * share for share in rotor_usage(run)]
    figure = make_figure(9, 3)
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.4))
    left.boxplot(
        usage,
        whis=(1, 99),
        showfliers=False,
        medianprops=dict(color=INK),
        patch_artist=True,
        boxprops=dict(facecolor="#d9d9d9"),
    )
    most = [share.max() for share in usage]
    left.plot(range(1, len(usage) + 1), most, "^", color=INK, ms=5, label="most")
    left.axhline(100.0, color=INK, lw=1, ls="--")
    left.set(xlabel="rotor", ylabel="thrust (% of its limit)", ylim=(0, 110))
    left.legend(loc="lower right")
    shares = np.sort(np.concatenate(usage))
    levels = np.linspace(0, 105, 211)
    above = 100 * (1 - np.searchsorted(shares, levels) / max(len(shares), 1))
    right.plot(levels, above, color=INK, lw=1.4)
    right.axvline(100.0, color=INK, lw=1, ls="--")
    right.set(xlabel="thrust (% of the limit)", ylabel="time above it (%)")
    right.set(xlim=(0, 110), ylim=(0, 102))
    return figure
