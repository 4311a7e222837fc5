"""Pictures of what an estimator knew, and of how sure it was."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter
from scipy.special import chdtr

from airrace.analysis.figure_style import (
    DESK,
    INK,
    MUTED,
    SHADE,
    Sheet,
    add_legend,
    add_tip,
    make_figure,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from airrace.analysis.run import Run

_BINS = 400  # of a line over time, each with its greatest value
_SIGMAS = 3.0
# Name, unit, and how many of it are in one of SI.
_ERRORS = (
    ("attitude", "°", np.rad2deg(1.0)),
    ("position", "cm", 100.0),
    ("velocity", "cm/s", 100.0),
)
_BIASES = (("gyro_bias", "°/s", np.rad2deg(1.0)), ("accelerometer_bias", "cm/s²", 100.0))
_LINES = {"x": "-", "y": "--", "z": ":"}
_COORDINATES = 8  # of the corners of a marker


def error_statistics(run: "Run") -> dict[str, float]:
    """Returns figures of the estimate from the first marker on, NaN where there are none.

    ``attitude``, ``position`` and ``velocity`` are root mean squares of the errors' lengths (rad,
    m, m/s); ``nees`` is the mean, a dimension; ``gap`` the longest time without a marker (s).
    """
    rows = _airborne(run)
    lengths = {
        name: np.linalg.norm(rows[[f"{name}_error_{axis}" for axis in "xyz"]], axis=1)
        for name, _, _ in _ERRORS
    }
    if not len(rows):
        return dict.fromkeys([*lengths, "nees", "gap"], np.nan)
    return {
        **{name: float(np.sqrt(np.nanmean(length**2))) for name, length in lengths.items()},
        "nees": float(rows["nees"].mean()),
        "gap": float((rows["exposure"] - rows["seen_at"]).max()),
    }


def errors_figure(run: "Run", sheet: Sheet = DESK) -> "Figure":
    """Returns the errors of attitude, position and velocity, with three standard deviations."""
    rows = _airborne(run)
    lines, columns = (len(_ERRORS), 3) if sheet.is_wide else (3 * len(_ERRORS), 1)
    figure = make_figure(sheet.width, 0.8 + 1.6 * lines)
    grid = figure.subplots(lines, columns, sharex=True).reshape(len(_ERRORS), 3)
    for (name, unit, scale), line in zip(_ERRORS, grid):
        for axis, axes in zip("xyz", line):
            error = scale * rows[f"{name}_error_{axis}"]
            bound = _SIGMAS * scale * rows[f"{name}_sigma_{axis}"]
            at = _greatest(error)
            time = rows["time"].to_numpy()[at]
            band = axes.fill_between(
                time, -bound.iloc[at], bound.iloc[at], color=SHADE, lw=0, label="3σ"
            )
            axes.plot(time, error.iloc[at], color=INK, lw=0.7, label="error")
            outside = 100 * np.mean(np.abs(error) > bound)
            rms = np.sqrt(np.mean(error**2))
            add_tip(band, f"{name} about {axis}" if name == "attitude" else f"{name} {axis}")
            axes.set_title(
                f"{axis}: RMS {rms:.2g} {unit}, {outside:.1f} % outside", size=8.5, weight="normal"
            )
            _mark_laps(axes, run)
            _limit(axes, np.maximum(np.abs(error), bound))
        for axes in line[: 1 if sheet.is_wide else 3]:
            axes.set_ylabel(f"{name} ({unit})")
    for axes in grid[-1, 0 if sheet.is_wide else 2 :]:
        axes.set_xlabel("time (s)")
    add_legend(figure, grid[0][0], "outside lower left")
    return figure


def certainty_figure(run: "Run", sheet: Sheet = DESK) -> "Figure":
    """Returns NEES, innovations, gaps without markers, and biases."""
    rows = _airborne(run)
    figure = make_figure(sheet.width, 5.0 if sheet.is_wide else 11.0)
    # On a desk two rows, of which the first has a wide panel; on a phone, all of one width.
    layout = ("aaaabb", "ccddee") if sheet.is_wide else "abcde"
    panels = figure.subplot_mosaic("\n".join(layout))
    nees, innovations, gaps, *biases = (panels[name] for name in "abcde")
    at = _greatest(rows["nees"])
    nees.plot(rows["time"].to_numpy()[at], rows["nees"].iloc[at], color=INK, lw=0.7)
    nees.axhline(1.0, color=INK, lw=1, ls="--")
    nees.set(xlabel="time (s)", ylabel="NEES per dimension", yscale="log")
    nees.yaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
    nees.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    nees.yaxis.set_minor_formatter(NullFormatter())
    nees.set_title(f"mean {rows['nees'].mean():.2f}", size=8.5, weight="normal")
    _draw_innovations(innovations, run.innovations["squared"].dropna().to_numpy())
    wait = rows["exposure"] - rows["seen_at"]
    at = _greatest(wait)
    gaps.plot(rows["time"].to_numpy()[at], wait.iloc[at], color=INK, lw=0.7)
    gaps.set(xlabel="time (s)", ylabel="since the last marker (s)")
    gaps.set_title(f"longest {wait.max():.1f} s", size=8.5, weight="normal")
    gaps.set_ylim(bottom=0.0)
    for axes, (name, unit, scale) in zip(biases, _BIASES):
        _draw_bias(axes, rows, name, scale)
        axes.set(xlabel="time (s)", ylabel=f"{name.replace('_', ' ')} ({unit})")
    add_legend(figure, biases[-1], "outside lower center")
    for axes in (nees, gaps, *biases):
        _mark_laps(axes, run)
    return figure


def _airborne(run: "Run") -> "pd.DataFrame":
    """Returns the rows of run.estimator from the first marker on."""
    return run.estimator[run.estimator["seen_at"] >= 0.0].dropna().reset_index(drop=True)


def _greatest(values: "pd.Series") -> np.ndarray:
    """Returns in which rows the greatest values of up to _BINS equal stretches are."""
    size = values.abs().to_numpy()
    parts = np.array_split(np.arange(len(size)), min(_BINS, max(len(size), 1)))
    return np.array([part[np.argmax(size[part])] for part in parts if len(part)], int)


def _mark_laps(axes: "Axes", run: "Run") -> None:
    for start in run.lap_starts:
        axes.axvline(start, color=MUTED, lw=0.6, ls=":")


def _limit(axes: "Axes", size: "pd.Series") -> None:
    """Leaves the few worst moments of a signal outside, which would make the others a line."""
    if len(size):
        most = 1.3 * float(np.nanpercentile(size, 98.0))
        axes.set_ylim(-most, most)


def _draw_innovations(axes: "Axes", squared: np.ndarray) -> None:
    """Draws how large innovations were, beside what they should be: chi-squared, of 8 numbers."""
    from airrace.systems.estimation.slam_filter import REFUSED

    levels = np.linspace(0.0, 40.0, 41)
    counts = np.histogram(np.clip(squared, 0.0, levels[-1]), levels)[0]
    share = 100 * counts / max(len(squared), 1)
    bars = axes.stairs(share, levels, fill=True, color=SHADE, label="innovations")
    add_tip(bars, f"{len(squared)} markers")
    expected = 100 * np.diff(chdtr(_COORDINATES, levels))
    axes.plot(levels[:-1] + 0.5, expected, color=INK, lw=1, ls="--")
    refused = 100 * np.mean(squared > REFUSED) if len(squared) else 0.0
    axes.set(xlabel="normalised innovation squared", ylabel="markers (%)")
    mean = squared[squared <= REFUSED].mean() if np.any(squared <= REFUSED) else np.nan
    axes.set_title(f"mean {mean:.1f} of 8, {refused:.1f} % refused", size=8.5, weight="normal")


def _draw_bias(axes: "Axes", rows: "pd.DataFrame", name: str, scale: float) -> None:
    step = max(1, len(rows) // _BINS)
    some = rows.iloc[::step]
    for axis, line in _LINES.items():
        value = scale * some[f"{name}_{axis}"]
        bound = _SIGMAS * scale * some[f"{name}_sigma_{axis}"]
        band = axes.fill_between(
            some["time"], value - bound, value + bound, color=SHADE, alpha=0.5, lw=0
        )
        add_tip(band, f"{name.replace('_', ' ')} {axis}, three standard deviations")
        axes.plot(some["time"], value, color=INK, lw=0.9, ls=line, label=axis)
