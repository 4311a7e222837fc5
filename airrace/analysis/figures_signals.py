"""Pictures of the map, of tracking, and of the rotors."""

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from matplotlib.ticker import MaxNLocator

from airrace.analysis.figure_style import (
    DESK,
    INK,
    MUTED,
    RMS,
    SHADE,
    SHADES,
    WORST,
    Sheet,
    add_legend,
    make_pair,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from airrace.analysis.run import Run

_BINS = 400  # of a line over time, each with its greatest value
_NUMBERS = 14, 11  # laps in the table of a map's errors whose numbers have room; on a phone


def map_by_lap(run: "Run") -> pd.DataFrame:
    """Returns the map's errors (m): a row a marker, a column a lap; 0 is the exploration."""
    times = np.unique(run.map["time"])
    # The map is written just after gate 1 is crossed.
    at = np.searchsorted(times, run.lap_starts).clip(max=len(times) - 1)
    errors = run.map.pivot(index="marker", columns="time", values="error")[times[at]]
    return errors.set_axis(range(len(at)), axis="columns").dropna(how="all")


def map_by_gate(run: "Run") -> pd.DataFrame:
    """Returns the RMS error of the markers of each gate (m): a row a gate, a column a lap."""
    return (map_by_lap(run) ** 2).groupby(lambda marker: marker // 4 + 1).mean() ** 0.5


def map_figure(run: "Run", sheet: Sheet = DESK) -> "Figure":
    """Returns the error of the map after the exploration and each lap: of all, and by gate."""
    errors, by_gate = 100 * map_by_lap(run), 100 * map_by_gate(run)
    laps, gates = errors.columns, by_gate.index
    height = 1.4 + 0.24 * max(len(gates), 6)
    figure, left, right = make_pair(sheet, (1.0, 2.4), (2.2, height))
    left.set(xlabel="after lap (0: exploring)", ylabel="front markers' error (cm)")
    front = errors[errors.index % 2 == 0]
    if len(front):
        left.plot(laps, front.max(), **WORST)
        left.plot(laps, np.sqrt((front**2).mean()), **RMS)
        add_legend(figure, left, f"outside {'lower' if sheet.is_wide else 'upper'} left")
    left.set_ylim(bottom=0.0)
    left.xaxis.set_major_locator(MaxNLocator(integer=True))
    right.set(xlabel="after lap", ylabel="gate", title="RMS of each gate's markers (cm)")
    right.grid(False)
    if len(gates):
        right.pcolormesh(
            laps, gates, by_gate, cmap=SHADES, vmin=0.0, shading="nearest", edgecolor="face", lw=0.2
        )
        right.set_yticks(gates)
        right.invert_yaxis()
        decimals = 1 if np.nanmax(by_gate.to_numpy()) >= 1.0 else 2
        if len(laps) <= _NUMBERS[not sheet.is_wide]:
            for lap, column in by_gate.items():
                for gate, error in column.dropna().items():
                    right.text(
                        lap, gate, f"{error:.{decimals}f}", ha="center", va="center", size=7.5
                    )
    right.xaxis.set_major_locator(MaxNLocator(integer=True))
    return figure


def tracking_figure(run: "Run", sheet: Sheet = DESK) -> "Figure":
    """Returns how far the drone was from its reference, over time and lap by lap."""
    time, lap, off = run.tracking["time"], run.tracking["lap"], 100 * run.tracking["distance"]
    figure, left, right = make_pair(sheet, (2.4, 1.0), (3.0, 2.2))
    left.set(xlabel="time (s)", ylabel="off the reference (cm)", yscale="log")
    bins = np.arange(len(time)) * min(_BINS, len(time)) // len(time)
    worst = off.groupby(bins).max().clip(lower=0.01)
    left.plot(time.groupby(bins).first(), worst, color=INK, lw=0.8)
    for start in run.lap_starts:
        left.axvline(start, color=MUTED, lw=0.6, ls=":")
    flown = lap.between(1, len(run.result["laps"]))
    worst = off[flown].groupby(lap[flown]).max()
    right.plot(worst.index, worst, **WORST)
    right.plot(worst.index, np.sqrt((off[flown] ** 2).groupby(lap[flown]).mean()), **RMS)
    right.set(xlabel="lap", ylabel="(cm)")
    right.set_ylim(bottom=0.0)
    right.xaxis.set_major_locator(MaxNLocator(integer=True))
    if len(worst):
        add_legend(figure, right)
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


def rotors_figure(run: "Run", sheet: Sheet = DESK) -> "Figure":
    """Returns how much of its thrust each rotor used."""
    usage = [100 * share for share in rotor_usage(run)]
    figure, left, right = make_pair(sheet, (1.0, 1.4), (3.0, 2.6))
    left.boxplot(
        usage,
        whis=(1, 99),
        showfliers=False,
        medianprops=dict(color=INK),
        patch_artist=True,
        boxprops=dict(facecolor=SHADE, edgecolor=INK),
        whiskerprops=dict(color=INK),
        capprops=dict(color=INK),
    )
    most = [share.max() for share in usage]
    left.plot(range(1, len(usage) + 1), most, "^", color=INK, ms=5, label="most")
    left.axhline(100.0, color=INK, lw=1, ls="--")
    left.set(xlabel="rotor", ylabel="thrust (% of its limit)", ylim=(0, 110))
    add_legend(figure, left)
    shares = np.sort(np.concatenate(usage))
    levels = np.linspace(0, 105, 211)
    above = 100 * (1 - np.searchsorted(shares, levels) / max(len(shares), 1))
    right.plot(levels, above, color=INK, lw=1.4)
    right.axvline(100.0, color=INK, lw=1, ls="--")
    right.set(xlabel="thrust (% of the limit)", ylabel="time above it (%)")
    right.set(xlim=(0, 110), ylim=(0, 102))
    return figure
