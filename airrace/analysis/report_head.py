"""The beginning of a report: how the race ended, and the laps."""

import numpy as np

from airrace.analysis import html
from airrace.analysis.figures_signals import rotor_usage
from airrace.scenario import trajectory_name

# Mean laps of the original system on student-airrace, from rest to rest (s).
ORIGINAL = (("3-D", 40.60), ("4-D", 41.52), ("6-D", 41.21))
_ORIGINAL_TRACK = "student-airrace"


def head(run) -> list:
    """Returns title, outcome, the most important numbers, and what is missing."""
    result = run.result
    kind = trajectory_name(result["trajectory"])
    planned = run.scenario.laps
    outcome = "Finished." if result["finished"] else f"Did not finish: {result['dnf_reason']}."
    body = [
        f"<h1>{html.escaped(result['drone'])} on {html.escaped(result['track'])}</h1>",
        f'<p class="faint">{html.escaped(kind)}, seed {result["seed"]}, '
        f"{len(result['laps'])} of {planned} laps, {html.escaped(result['wall']['simulation'])}; "
        f"{html.escaped(run.folder.resolve().name)}</p>",
        f"<p><strong>{html.escaped(outcome)}</strong></p>",
        html.facts(_facts(run)),
    ]
    if not run.recorded:
        body.append(
            html.note(
                "This race was not recorded (--record none), so that there is nothing here on "
                "where it flew, how well it kept to its plan, and its rotors."
            )
        )
    elif not run.complete:
        times = run.columns["state"]["time"]
        until = f"{times[-1]:.1f} s" if len(times) else "before it began"
        body.append(
            html.note(f"The recording ends at {until}: the race was killed, or it still goes on.")
        )
    if run.scenario.disturbances.gate_shift > 0.0:
        body.append(
            html.note(
                "The gates moved during this race; the map's errors and the track "
                "shown are against where they stood when it began."
            )
        )
    return body


def _facts(run) -> list:
    result = run.result
    exploration = result["exploration"]
    pairs = []
    if result["laps"]:
        pairs += [
            ("best lap", f"{result['best_lap_s']:.2f} s"),
            ("mean lap", f"{result['mean_lap_s']:.2f} s"),
            ("top speed", f"{max(lap['max_speed'] for lap in result['laps']):.1f} m/s"),
        ]
    pairs.append(("exploration", f"{exploration['time_s']:.1f} s"))
    pairs.append(("gates found", exploration["gates_found"]))
    rms = [lap["map_rms_m"] for lap in result["laps"] if lap["map_rms_m"] is not None]
    if rms:
        pairs.append(("map error at the end", f"{100 * rms[-1]:.1f} cm"))
    tracking = run.columns["tracking"]
    off = tracking["distance"][(tracking["lap"] >= 1) & (tracking["lap"] <= len(result["laps"]))]
    if len(off):
        pairs.append(("tracking error", f"{100 * np.sqrt(np.mean(off**2)):.1f} cm"))
    usage = [share.max() for share in rotor_usage(run) if len(share)]
    if usage:
        pairs.append(("most of a rotor's thrust", f"{100 * max(usage):.0f} %"))
    return pairs


def lap_table(run) -> str:
    """Returns the table of laps and splits, with the original system's beside them."""
    result, n = run.result, len(run.track.gates)
    laps = result["laps"]
    splits = np.array([np.diff([*lap["gate_times_s"], lap["time_s"]]) for lap in laps])
    columns = [
        "lap",
        "time (s)",
        "planned (s)",
        *(f"{i + 1}\u2013{(i + 1) % n + 1}" for i in range(n)),
    ]
    rows = []
    for lap, split in zip(laps, splits):
        planned = f"{lap['plan']['duration_s']:.2f}" if lap["plan"] else "\u2013"
        kind = "best" if lap["time_s"] == result["best_lap_s"] else ""
        rows.append(
            (kind, [lap["lap"], f"{lap['time_s']:.2f}", planned, *(f"{s:.2f}" for s in split)])
        )
    means = splits.mean(axis=0)
    rows.append(("", ["mean", f"{result['mean_lap_s']:.2f}", "", *(f"{s:.2f}" for s in means)]))
    caption = "Times from gate to gate (s); bold: the best lap."
    if result["track"] == _ORIGINAL_TRACK:
        for kind, time in ORIGINAL:
            rows.append(("other", [f"original, {kind}", f"{time:.2f}", "", *[""] * n]))
        caption += (
            " Original: mean lap of the Student AirRace system on this track, from rest to rest."
        )
    return html.table(columns, rows, caption)
