"""An evaluation in one picture: a strip for each figure of merit, with a mark for every race."""

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from matplotlib import rc_context
from matplotlib.ticker import MaxNLocator

from airrace.analysis.figure_style import (
    DESK,
    INK,
    MUTED,
    PAPER,
    SHADE,
    STYLE,
    Sheet,
    add_legend,
    add_tip,
    make_figure,
)
from airrace.common.colors import BAD, BEST
from airrace.common.files import write_bytes
from airrace.evaluation.store import PICTURE
from airrace.evaluation.summary import race_frame, wilson_interval
from airrace.evaluation.tables import title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_REASONS, _REASON_LENGTH = 8, 34  # how many; characters of each
_BINS = 80  # places along a strip; marks of one place are beside each other
_KINDS = ((True, BEST, "o", "finished"), (False, BAD, "X", "did not finish"))


def draw_picture(folder: Path, evaluation: dict) -> None:
    """Writes evaluation.png.

    Args: evaluation: what evaluation.json holds.

    Raises UserError if it cannot be written.
    """
    file = io.BytesIO()
    with rc_context(STYLE):
        # No name and version of what drew it: the same evaluation, the same file.
        options: dict[str, Any] = dict(dpi=110, metadata={"Software": None})
        make_overview(evaluation).savefig(file, format="png", **options)
    write_bytes(folder / PICTURE, file.getvalue())


def make_overview(evaluation: dict, with_title: bool = True, sheet: Sheet = DESK) -> "Figure":
    """Returns the figure: strips on the left, rates and why races ended on the right.

    Args: with_title: whether it says what was evaluated. sheet: on a phone's, all is one below the
    other.
    """
    summary, races = evaluation["summary"], race_frame(evaluation["races"])
    strips = figures_of_merit(races)
    n = len(strips)
    if sheet.is_wide:
        figure = make_figure(13, 1.9 + 1.25 * n)
        grid = figure.add_gridspec(n, 2, width_ratios=(2.3, 1))
        places = [*(grid[row, 0] for row in range(n)), grid[:2, 1], grid[2:, 1]]
    else:
        figure = make_figure(sheet.width, 1.9 + 1.4 * n + 4.5)
        grid = figure.add_gridspec(n + 2, 1, height_ratios=[*[1.4] * n, 2.0, 2.5])
        places = [grid[row, 0] for row in range(n + 2)]
    if with_title:
        figure.suptitle(title(evaluation["settings"]), parse_math=False, wrap=True)
    *rows, rates, reasons = map(figure.add_subplot, places)
    for axes, (name, values) in zip(rows, strips.items()):
        _draw_strip(axes, name, values, races["finished"], sheet)
    _draw_rates(rates, summary)
    _draw_reasons(reasons, summary["dnf_reasons"])
    add_legend(figure, rows[0], "outside lower left")
    return figure


def figures_of_merit(races: pd.DataFrame) -> dict[str, pd.Series]:
    """Returns what races are compared by, a number a race, NaN where it has none."""
    mean_lap = races["mean_lap_s"].astype(float)
    strips = {
        "exploration (s)": races["exploration_s"],
        "mean lap (s)": mean_lap,
        "best lap (s)": races["best_lap_s"],
        # Laps of tracks of different lengths can be compared by this alone.
        "speed, straight from gate to gate, mean of the laps (m/s)": races["length_m"] / mean_lap,
        "map error, RMS (cm)": 100 * races["map_rms_m"].astype(float),
    }
    return {name: values.astype(float) for name, values in strips.items()}


def beside(values: np.ndarray) -> np.ndarray:
    """Returns how far beside its strip's middle each mark is, so that all are seen, -1 to 1."""
    ends = np.min(values), np.max(values)
    places = np.digitize(values, np.linspace(*ends, _BINS)) if ends[0] < ends[1] else 0 * values
    ranks = pd.Series(places).groupby(places).cumcount().to_numpy()
    # 0, 1, -1, 2, -2, ...
    steps = np.where(ranks % 2, (ranks + 1) // 2, -(ranks // 2))
    return steps / max(5, np.abs(steps).max())


def _draw_strip(
    axes: "Axes", name: str, values: pd.Series, finished: pd.Series, sheet: Sheet
) -> None:
    """Draws a mark a race, the median, and the quartiles."""
    known = values.dropna()
    axes.set(ylim=(-1.25, 1.25), yticks=[])
    axes.spines["left"].set_visible(False)
    axes.set_title(name, loc="left", fontsize=9)
    if known.empty:
        return _say_nothing(axes)
    low, median, high = known.quantile([0.25, 0.5, 0.75])
    axes.axvspan(low, high, color=SHADE, lw=0, label="half of the races", zorder=1)
    axes.axvline(median, color=INK, lw=1.6, label="median", zorder=2)
    words = f"median {median:.4g}, {len(known)} races"
    if sheet.is_wide:
        axes.set_title(words, loc="right", fontsize=9, weight=400)
    else:  # beside the name there is no room
        axes.set_title(f"{name}\n{words}", loc="left", fontsize=9)
    heights = pd.Series(beside(known.to_numpy()), known.index)
    size = float(np.clip(1500 / len(known), 14, 55))
    for kind, color, marker, label in _KINDS:
        shown = known[finished[known.index] == kind]
        # All strips have one legend, which is to name what any of them has.
        look: dict[str, Any] = dict(s=size, c=color, marker=marker, edgecolors=PAPER)
        marks = axes.scatter(
            shown, heights[shown.index], linewidths=0.5, label=label, zorder=3, **look
        )
        add_tip(marks, label)
    axes.margins(x=0.03)


def _draw_rates(axes: "Axes", summary: dict) -> None:
    """Marks with their Wilson intervals of 95 %."""
    races = summary["races"]
    names = {"finished": "finished", "explored": "explored", "collisions": "collided"}
    colors = (BEST, INK, BAD)
    labels = []
    for y, (key, color) in enumerate(zip(names, colors)):
        count = summary[key]
        rate = 100 * count / races if races else 0.0
        low, high = (100 * end for end in wilson_interval(count, races))
        axes.plot([low, high], [y, y], color=color, lw=5, alpha=0.45, solid_capstyle="butt")
        axes.plot(rate, y, "o", color=color, mec=PAPER, ms=9)
        labels.append(f"{names[key]}\n{count} of {races}")
    axes.set_yticks(range(len(names)), labels)
    axes.set(xlabel="races (%); bars: 95 % intervals", xlim=(-2, 102), ylim=(2.5, -0.5))
    axes.grid(axis="y", visible=False)


def _draw_reasons(axes: "Axes", reasons: dict) -> None:
    axes.set_title("why races did not finish", fontsize=9)
    if not reasons:
        return _say_nothing(axes, "all finished")
    shown = list(reasons.items())
    if len(shown) > _REASONS:
        others = sum(count for _, count in shown[_REASONS - 1 :])
        shown = [*shown[: _REASONS - 1], ("others", others)]
    names, counts = zip(*shown)
    most = _REASON_LENGTH
    names = [name if len(name) <= most else f"{name[: most - 1]}\u2026" for name in names]
    axes.barh(range(len(shown)), counts, height=0.5, color=BAD)
    axes.set_yticks(range(len(shown)), names, parse_math=False)
    axes.set(xlabel="races", ylim=(max(len(shown), 5) - 0.4, -0.6))
    axes.grid(axis="y", visible=False)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))


def _say_nothing(axes: "Axes", words: str = "nothing to show") -> None:
    axes.text(0.5, 0.5, words, ha="center", va="center", transform=axes.transAxes, color=MUTED)
    axes.set(xticks=[], yticks=[])
