"""Pictures of where time was lost, and of what the explorer did."""

import numpy as np

from airrace.analysis.svg import INK, lap_style, make_figure

_NEAR = 0.1  # s by which a drone joins its circuit after a gate, and it still counts
_HATCHES = ("", "///", "...", "xx", "\\\\\\", "++", "oo", "--")
_GREYS = ("#ffffff", "#d0d0d0", "#f0f0f0", "#b0b0b0", "#e0e0e0", "#c0c0c0")


def time_lost(run) -> dict:
    """Returns by how much each lap was behind its plan at each gate.

    It counts from the first gate on at which the drone was on the plan's circuit: on the
    way onto it, a plan says nothing of gates.

    Returns:
        {lap: array}, flown minus planned time (s) at gates 1, 2, ... and 1 again, NaN
        before it counts; laps without a plan that knows its gates are left out.
    """
    columns, result = run.columns, {}
    plans, gates = columns["plans"], columns["plan_gates"]
    for lap in run.result["laps"]:
        made_for = np.flatnonzero(plans["lap"] <= lap["lap"])
        if not len(made_for):
            continue
        i = made_for[-1]
        planned = gates["time"][gates["plan"] == plans["plan"][i]].astype(float)
        flown = np.array([*lap["gate_times_s"], lap["time_s"]])
        if len(planned) != len(flown):
            continue
        joined = plans["start_time"][i] + plans["entry_duration"][i] - lap["start_s"]
        behind = np.where(flown >= joined - _NEAR, flown - planned, np.nan)
        if np.isfinite(behind).any():
            result[lap["lap"]] = behind - behind[np.isfinite(behind)][0]
    return result


def time_lost_figure(run):
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
    axes.set_xticks(range(n + 1), [*range(1, n + 1), 1])
    figure.legend(loc="outside right center")
    return figure


def states(run) -> list:
    """Returns name, start and end (s) of every state of the explorer, in order."""
    events = run.result["exploration"]["events"]
    table = run.columns["events"]
    mine = table["source"] == "explorer" if len(table["time"]) else np.array([], bool)
    if mine.sum() > len(events):  # the log is newer, of a race that was killed
        events = [
            {"state": name, "time_s": float(time)}
            for name, time in zip(table["name"][mine], table["time"][mine])
        ]
    starts = run.lap_starts
    last = events[-1]["time_s"] if events else 0.0
    end = starts[0] if len(starts) else max([last, *run.columns["state"]["time"][-1:]])
    ends = [*(e["time_s"] for e in events[1:]), max(end, last)]
    return [(e["state"], e["time_s"], end) for e, end in zip(events, ends)]


def timeline_figure(run):
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
