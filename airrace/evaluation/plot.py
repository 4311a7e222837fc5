"""An evaluation in one picture."""

import io
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from airrace.common.errors import UserError
from airrace.evaluation.store import PICTURE
from airrace.evaluation.summary import wilson_interval
from airrace.evaluation.tables import title

_GOOD, _BAD, _PLAIN = "#2a9d5c", "#c8503c", "#3b6ea5"
_REASON_LENGTH = 34  # characters


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
    FigureCanvasAgg(make_figure(evaluation)).print_png(file, metadata={"Software": None})
    path = folder / PICTURE
    try:
        path.write_bytes(file.getvalue())
    except OSError as e:
        raise UserError(f"{path} cannot be written ({e.strerror}); make room there.") from None


def make_figure(evaluation: dict) -> Figure:
    """Returns the figure: rates, three distributions, laps by track, and why races ended."""
    summary, lines = evaluation["summary"], evaluation["races"]
    figure = Figure(figsize=(13, 7.5), layout="constrained")
    figure.suptitle(title(evaluation["settings"]), parse_math=False, wrap=True)
    axes = figure.subplots(2, 3)
    _draw_rates(axes[0, 0], summary)
    _draw_histogram(axes[0, 1], "exploration time (s)", [r["exploration_s"] for r in lines])
    _draw_histogram(
        axes[0, 2], "lap time (s)", [t for r in lines for t in r["lap_times_s"]], "laps"
    )
    rms = [None if r["map_rms_m"] is None else 100 * r["map_rms_m"] for r in lines]
    _draw_histogram(axes[1, 0], "map error, RMS (cm)", rms)
    _draw_laps(axes[1, 1], lines)
    _draw_reasons(axes[1, 2], summary["dnf_reasons"])
    return figure


def _draw_rates(axes, summary):
    """Bars with their Wilson intervals of 95 %."""
    races = summary["races"]
    bars = (
        ("finished", summary["finished"], _GOOD),
        ("explored", summary["explored"], _PLAIN),
        ("collided", summary["collisions"], _BAD),
    )
    for x, (_, count, colour) in enumerate(bars):
        rate = count / races if races else 0.0
        low, high = wilson_interval(count, races)
        axes.bar(x, 100 * rate, color=colour, width=0.6)
        axes.errorbar(
            x, 100 * rate, [[100 * (rate - low)], [100 * (high - rate)]], color="black", capsize=6
        )
        axes.annotate(
            f"{count}/{races}", (x, 100 * high), (0, 4), ha="center", textcoords="offset points"
        )
    axes.set_xticks(range(len(bars)), [name for name, *_ in bars])
    axes.set(title="rates, with 95 % intervals", ylabel="races (%)", ylim=(0, 112))


def _draw_histogram(axes, name, values, what="races"):
    values = sorted(value for value in values if value is not None)
    axes.set(title=name, ylabel=what)
    if not values:
        return _say_nothing(axes)
    axes.hist(values, bins=min(30, max(5, round(len(values) ** 0.5))), color=_PLAIN)
    median = (
        values[len(values) // 2]
        if len(values) % 2
        else (values[len(values) // 2 - 1] + values[len(values) // 2]) / 2
    )
    axes.axvline(median, color="black", linestyle="--", label=f"median {median:.2f}")
    axes.legend(frameon=False)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))


def _draw_laps(axes, lines):
    axes.set(
        title="mean lap against the track's length",
        xlabel="length, gate to gate (m)",
        ylabel="mean lap (s)",
    )
    points = [(r["length_m"], r["mean_lap_s"], r["finished"]) for r in lines if r["lap_times_s"]]
    if not points:
        return _say_nothing(axes)
    for finished, colour, marker, name in (
        (True, _GOOD, "o", "finished"),
        (False, _BAD, "x", "did not finish"),
    ):
        shown = [(x, y) for x, y, ended in points if ended == finished]
        if shown:
            axes.scatter(*zip(*shown), color=colour, marker=marker, s=25, label=name)
    axes.legend(frameon=False)


def _draw_reasons(axes, reasons):
    axes.set(title="why races did not finish", xlabel="races")
    if not reasons:
        return _say_nothing(axes, "all finished")
    shown = list(reasons.items())[:8]
    if len(reasons) > 8:
        shown = [*shown[:7], ("others", sum(list(reasons.values())[7:]))]
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
