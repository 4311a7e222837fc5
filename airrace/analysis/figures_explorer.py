"""A picture of what the explorer did."""

from typing import TYPE_CHECKING

from airrace.analysis.figure_style import DESK, FAINT, MUTED, Sheet, add_tip, make_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from airrace.analysis.run import Run


def states(run: "Run") -> list:
    """Returns name, start and end (s) of every state of the explorer, in order."""
    events = [(event["state"], event["time_s"]) for event in run.result["exploration"]["events"]]
    logged = run.events[run.events["source"] == "explorer"]
    if len(logged) > len(events):  # of a race that was killed
        events = list(zip(logged["name"], logged["time"].tolist()))
    last = events[-1][1] if events else 0.0
    end = max([last, *(run.lap_starts[:1] if len(run.lap_starts) else run.state["time"][-1:])])
    ends = [*(time for _, time in events[1:]), end]
    return [(state, start, end) for (state, start), end in zip(events, ends)]


def timeline_figure(run: "Run", sheet: Sheet = DESK) -> "Figure":
    """Returns the explorer's states over time."""
    spans = states(run)
    names = list(dict.fromkeys(name for name, *_ in spans))
    figure = make_figure(sheet.width, 0.9 + 0.24 * max(len(names), 1))
    axes = figure.add_subplot(xlabel="time (s)")
    for name, start, end in spans:
        bars = axes.broken_barh(
            [(start, max(end - start, 0.05))],
            (names.index(name) - 0.36, 0.72),
            facecolor=FAINT,
            edgecolor=MUTED,
            lw=0.6,
        )
        add_tip(bars, f"{name}: {start:.1f} to {end:.1f} s")
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.grid(axis="y", visible=False)
    axes.margins(x=0.01)
    return figure
