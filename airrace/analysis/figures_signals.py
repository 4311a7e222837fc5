"""Pictures of the map, of tracking, and of the rotors."""

import numpy as np
from matplotlib.ticker import MaxNLocator

from airrace.analysis.svg import GREYS, INK, add_colorbar, make_figure

_BINS = 400  # of a line over time, each with its greatest value


def map_by_lap(run) -> dict:
    """Returns the map's errors after the exploration (0) and each lap.

    Returns:
        {lap: {marker: error (m)}}.
    """
    table, result = run.columns["map"], {}
    times = np.unique(table["time"])
    for lap, start in enumerate(run.lap_starts):
        # The map is written just after gate 1 is crossed.
        now = times[max(np.searchsorted(times, start), 0) :][:1]
        if not len(now):
            now = times[-1:]
        rows = table["time"] == now
        result[lap] = dict(zip(table["marker"][rows].tolist(), table["error"][rows].tolist()))
    return result


def map_figure(run):
    """Returns the error of every marker in the map after the exploration and each lap."""
    errors = map_by_lap(run)
    markers = sorted({marker for lap in errors.values() for marker in lap})
    figure = make_figure(9, 3.8)
    left, right = figure.subplots(1, 2, width_ratios=(1, 2.4))
    laps = list(errors)
    values = np.array([[100 * errors[lap].get(m, np.nan) for m in markers] for lap in laps])
    front = [i for i, m in enumerate(markers) if m % 2 == 0]
    left.set(xlabel="after lap (0: exploring)", ylabel="front markers' error (cm)")
    if front:
        rms = np.sqrt(np.nanmean(values[:, front] ** 2, axis=1))
        left.plot(
            laps,
            np.nanmax(values[:, front], axis=1),
            "s--",
            color=INK,
            ms=4,
            lw=1,
            mfc="white",
            label="worst",
        )
        left.plot(laps, rms, "o-", color=INK, ms=4, lw=1.2, label="RMS")
        left.legend()
    left.set_ylim(bottom=0.0)
    left.xaxis.set_major_locator(MaxNLocator(integer=True))
    right.grid(False)
    if markers:
        cells = right.pcolormesh(
            laps,
            range(len(markers)),
            values.T,
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


def tracking_figure(run):
    """Returns how far the drone was from its reference, over time and lap by lap."""
    tracking = run.columns["tracking"]
    time, off = tracking["time"], 100 * tracking["distance"]
    figure = make_figure(9, 3)
    left, right = figure.subplots(1, 2, width_ratios=(2.4, 1))
    left.set(xlabel="time (s)", ylabel="off the reference (cm)", yscale="log")
    edges = (
        np.linspace(0, len(time), _BINS + 1).astype(int)
        if len(time) > _BINS
        else (np.arange(len(time) + 1))
    )
    left.plot(
        [time[a] for a in edges[:-1]],
        [max(off[a:b].max(), 0.01) for a, b in zip(edges, edges[1:])],
        color=INK,
        lw=0.8,
    )
    for start in run.lap_starts:
        left.axvline(start, color="#999", lw=0.6, ls=":")
    laps = [lap for lap in np.unique(tracking["lap"]) if 1 <= lap <= len(run.result["laps"])]
    mine = [off[tracking["lap"] == lap] for lap in laps]
    right.plot(
        laps, [d.max() for d in mine], "s--", color=INK, ms=4, lw=1, mfc="white", label="worst"
    )
    right.plot(
        laps, [np.sqrt(np.mean(d**2)) for d in mine], "o-", color=INK, ms=4, lw=1.2, label="RMS"
    )
    right.set(xlabel="lap", ylabel="(cm)")
    right.set_ylim(bottom=0.0)
    right.xaxis.set_major_locator(MaxNLocator(integer=True))
    if laps:
        right.legend()
    return figure


def rotor_usage(run) -> list:
    """Returns the thrust of each rotor while racing, as shares of its limit, 0 to 1."""
    rotors = run.columns["rotors"]
    racing = (rotors["lap"] >= 1) & (rotors["lap"] <= run.scenario.laps)
    if not racing.any():
        racing = rotors["time"] >= 0.0
    return [
        rotors["thrust"][racing & (rotors["rotor"] == i)] / limit
        for i, limit in enumerate(run.vehicle.max_thrusts.tolist(), 1)
    ]


def rotors_figure(run):
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
    left.plot(
        range(1, len(usage) + 1),
        [share.max() for share in usage],
        "^",
        color=INK,
        ms=5,
        label="most",
    )
    left.axhline(100.0, color=INK, lw=1, ls="--")
    left.set(xlabel="rotor", ylabel="thrust (% of its limit)", ylim=(0, 110))
    left.legend(loc="lower right")
    shares = np.sort(np.concatenate(usage))
    levels = np.linspace(0, 105, 211)
    above = 100 * (1 - np.searchsorted(shares, levels) / max(len(shares), 1))
    right.plot(levels, above, color=INK, lw=1.4)
    right.axvline(100.0, color=INK, lw=1, ls="--")
    right.set(
        xlabel="thrust (% of the limit)", ylabel="time above it (%)", xlim=(0, 110), ylim=(0, 102)
    )
    return figure
