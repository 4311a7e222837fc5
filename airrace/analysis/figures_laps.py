"""Pictures of where time was lost, and of what the explorer did."""

from typing import TYPE_CHECKING

import numpy as np

from airrace.analysis.figure_style import INK, lap_style, make_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from airrace.analysis.run import Run

_NEAR = 0.1  # s by which a drone joins its circuit after a gate, and it still counts
_HATCHES = ("", "///", "...", "xx", "\\\\\\", "++", "oo", "--")
_GREYS = ("#ffffff", "#d0d0d0", "#f0f0f0", "#b0b0b0", "#e0e0e0", "#c0c0c0")


def time_lost(run: "Run") -> dict:
    """Returns by how much each lap was behind its plan at each gate.

    It counts from the first gate on at which the drone was on the plan's circuit: of its
    entry, a plan says nothing of gates.

    Returns:
        {lap: array}, flown minus planned time (s) at gates 1, 2, ... and 1 again, NaN
        before it counts; laps without a plan that knows its gates are left out.
    """
    result = {}
    for lap in run.result["laps"]:
        plans = run.plans[run.plans["lap"] <= lap["lap"]]
        if plans.empty:
            continue
        plan = plans.iloc[-1]
        planned = run.plan_gates["time"][run.plan_gates["plan"] == plan["plan"]].to_numpy()
        flown = np.array([*lap["gate_times_s"], lap["time_s"]])
        if len(planned) != len(flown):
            continue
        joined = plan["start_time"] + plan["entry_duration"] - lap["start_s"]
        behind = np.where(flown >= joined - _NEAR, flown - planned, np.nan)
        if np.isfinite(behind).any():
            result[lap["lap"]] = behind - behind[np.isfinite(behind)][0]
    return result


def time_lost_figure(run: "Run") -> "Figure":
    """Returns the picture of time_lost()."""
    lost = time_lost(run)
    most = max((np.nanmax(np.abs(behind)) for behind in lost.values()), default=0.0)
    unit, factor = ("ms", 1000.0) if most < 0.1 else ("s", 1.0)
    figure = make_figure(9, 3.6)
    axes = figure.add_subplot(xlabel="at gate", ylabel=f"behind the lap's plan ({unit})")
    n = len(run.track.gates)
    for lap, behind in lost.items():
        axes.plot(range(n + 1), factor * behind, label=f"lap {lap}", **lap_style(lap))
    axes.axhline(0.0, color=INK, lw=0.8)
    axes.set_xticks(range(n + 1), [*range(1, n + 1), 1])  # type: ignore[list-item]
    figure.legend(loc="outside right center")
    return figure


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


def timeline_figure(run: "Run") -> "Figure":
    """Returns the explorer's states over time."""
    spans = states(run)
    names = list(dict.fromkeys(name for name, *_ in spans))
    figure = make_figure(9, 0.9 + 0.28 * max(len(names), 1))
    axes = figure.add_subplot(xlabel="time (s)")
    for i, name in enumerate(names):
        bars = [(start, max(end - start, 0.05)) for other, start, end in spans if other == name]
        axes.broken_barh(
            bars,
            (i - 0.36, 0.72),
            facecolor=_GREYS[i % len(_GREYS)],
            hatch=_HATCHES[i % len(_HATCHES)],
            edgecolor=INK,
            lw=0.6,
        )
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.grid(axis="y", visible=False)
    axes.margins(x=0.01)
    return figure
