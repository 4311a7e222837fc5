"""An evaluation in one picture."""

import io
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from airrace.common.files import write_bytes
from airrace.evaluation.store import PICTURE
from airrace.evaluation.summary import race_frame, wilson_interval
from airrace.evaluation.tables import title

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_GOOD, _BAD, _PLAIN = "#2a9d5c", "#c8503c", "#3b6ea5"
_REASONS, _REASON_LENGTH = 8, 34  # how many; characters of each


def draw_picture(folder: Path, evaluation: dict) -> None:
    """Writes evaluation.png.

    Args:
        folder: where to.
        evaluation: what evaluation.json holds.

    Raises:
        UserError: if it cannot be written.
    """
    file = io.BytesIO()
    # No name and version of what drew it: the same evaluation, the same file.
    make_figure(evaluation).savefig(file, format="png", metadata={"Software": None})
    write_bytes(folder / PICTURE, file.getvalue())


def make_figure(evaluation: dict) -> Figure:
    """Returns the figure: rates, three distributions, laps by track, and why races ended."""
    summary, races = evaluation["summary"], race_frame(evaluation["races"])
    figure = Figure(figsize=(13, 7.5), layout="constrained")
    figure.suptitle(title(evaluation["settings"]), parse_math=False, wrap=True)
    axes = figure.subplots(2, 3)
    _draw_rates(axes[0, 0], summary)
    _draw_histogram(axes[0, 1], "exploration time (s)", races["exploration_s"])
    _draw_histogram(axes[0, 2], "lap time (s)", races["lap_times_s"].explode(), "laps")
    _draw_histogram(axes[1, 0], "map error, RMS (cm)", 100 * races["map_rms_m"].astype(float))
    _draw_laps(axes[1, 1], races.dropna(subset="mean_lap_s"))
    _draw_reasons(axes[1, 2], summary["dnf_reasons"])
    return figure


def _draw_rates(axes, summary):
    """Bars with their Wilson intervals of 95 %."""
    races = summary["races"]
    colors = {"finished": _GOOD, "explored": _PLAIN, "collisions": _BAD}
    for x, (key, color) in enumerate(colors.items()):
        count = summary[key]
        rate = 100 * count / races if races else 0.0
        low, high = (100 * end for end in wilson_interval(count, races))
        axes.bar(x, rate, color=color, width=0.6)
        axes.errorbar(x, rate, [[rate - low], [high - rate]], color="black", capsize=6)
        axes.annotate(
            f"{count}/{races}", (x, high), (0, 4), ha="center", textcoords="offset points"
        )
    axes.set_xticks(range(len(colors)), ["finished", "explored", "collided"])
    axes.set(title="rates, with 95 % intervals", ylabel="races (%)", ylim=(0, 112))


def _draw_histogram(axes: "Axes", name: str, values: pd.Series, what: str = "races") -> None:
    values = values.dropna().astype(float)
    axes.set(title=name, ylabel=what)
    if values.empty:
        return _say_nothing(axes)
    axes.hist(values, bins=min(30, max(5, round(len(values) ** 0.5))), color=_PLAIN)
    median = values.median()
    axes.axvline(median, color="black", linestyle="--", label=f"median {median:.2f}")
    axes.legend(frameon=False)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))


def _draw_laps(axes: "Axes", races: pd.DataFrame) -> None:
    axes.set(
        title="mean lap against the track's length",
        xlabel="length, gate to gate (m)",
        ylabel="mean lap (s)",
    )
    if races.empty:
        return _say_nothing(axes)
    for finished, color, marker, name in (
        (True, _GOOD, "o", "finished"),
        (False, _BAD, "x", "did not finish"),
    ):
        shown = races[races["finished"] == finished]
        if len(shown):
            axes.scatter(
                shown["length_m"], shown["mean_lap_s"], color=color, marker=marker, s=25, label=name
            )
    axes.legend(frameon=False)


def _draw_reasons(axes: "Axes", reasons: dict) -> None:
    axes.set(title="why races did not finish", xlabel="races")
    if not reasons:
        return _say_nothing(axes, "all finished")
    shown = list(reasons.items())
    if len(shown) > _REASONS:
        others = sum(count for _, count in shown[_REASONS - 1 :])
        shown = [*shown[: _REASONS - 1], ("others", others)]
    names = [
        name if len(name) <= _REASON_LENGTH else name[: _REASON_LENGTH - 1] + "\u2026"
        for name, _ in shown
    ]
    axes.barh(range(len(shown)), [count for _, count in shown], color=_BAD)
    axes.set_yticks(range(len(shown)), names, parse_math=False)
    axes.invert_yaxis()
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))


def _say_nothing(axes, words="nothing to show"):
    axes.text(0.5, 0.5, words, ha="center", va="center", transform=axes.transAxes, color="grey")
    axes.set(xticks=[], yticks=[])
