"""What the races of an evaluation amount to."""

import re

import pandas as pd

_COLUMNS = (
    *("seed", "gates", "length_m", "finished", "dnf_reason", "explored", "exploration_s"),
    *("gates_found", "lap_times_s", "mean_lap_s", "best_lap_s", "map_rms_m", "collisions"),
)


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """Returns the Wilson score interval of a success rate, of 95 %.

    E. B. Wilson, "Probable inference, the law of succession, and statistical
    inference", J. Am. Stat. Assoc. 22 (1927), 209-212. Unlike the one from the
    normal approximation it is sensible for few trials and for rates of 0 and 1.

    Args: successes, trials: numbers; 0 <= successes <= trials.
    """
    from scipy.stats import binomtest  # here, as few processes need it: it takes half a second

    if trials == 0:
        return 0.0, 1.0
    interval = binomtest(successes, trials).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)


def race_line(row: dict) -> dict:
    """Returns the numbers of one race from its row, see fly(); no wall times.

    ``exploration_s`` is None unless the loop was closed. ``map_rms_m`` is of the
    end of the last lap; None without a lap.
    """
    result = row["result"]
    exploration, laps = result["exploration"], result["laps"]
    return {
        **{name: row[name] for name in ("seed", "gates", "length_m")},
        **{name: result[name] for name in ("finished", "dnf_reason")},
        "explored": exploration["success"],
        "exploration_s": exploration["time_s"] if exploration["success"] else None,
        "gates_found": exploration["gates_found"],
        "lap_times_s": [lap["time_s"] for lap in laps],
        **{name: result[name] for name in ("mean_lap_s", "best_lap_s")},
        "map_rms_m": laps[-1]["map_rms_m"] if laps else None,
        "collisions": result["collisions"],
    }


def race_frame(lines: list[dict]) -> pd.DataFrame:
    """Returns the table of some races; lines: see race_line()."""
    return pd.DataFrame(lines, columns=_COLUMNS).astype({"finished": bool, "explored": bool})


def summarize(lines: list[dict]) -> dict:
    """Returns the numbers of many races, of their race_line()s.

    Distributions are ``n``, ``mean``, ``median``, ``min`` and ``max``, or None
    if there is nothing to tell. Lap times and speeds are over all complete laps.
    """
    races = race_frame(lines)
    laps = races.explode("lap_times_s").dropna(subset="lap_times_s")
    finished = int(races["finished"].sum())
    reasons = races["dnf_reason"][~races["finished"]].map(dnf_class).value_counts()
    return {
        "races": len(lines),
        "finished": finished,
        "finish_rate": finished / len(lines) if lines else None,
        "finish_rate_95": list(wilson_interval(finished, len(lines))),
        "explored": int(races["explored"].sum()),
        "exploration_s": _distribution(races["exploration_s"]),
        "lap_s": _distribution(laps["lap_times_s"]),
        "lap_speed": _distribution(laps["length_m"] / laps["lap_times_s"]),
        "map_rms_m": _distribution(races["map_rms_m"]),
        "collisions": int(races["collisions"].sum()),
        "dnf_reasons": reasons.sort_index().sort_values(ascending=False, kind="stable").to_dict(),
    }


def dnf_class(reason: str) -> str:
    """Returns a reason without numbers and what led to it: reasons to be counted."""
    reason = re.sub(r"^(ran out of time in state \w+):.*", r"\1", reason)
    reason = re.sub(r" (at|by|after|in) [\d.]+ (s|m/s|m|degrees|pictures)\b", "", reason)
    return re.sub(r"\b(pylon|board)_\w+", r"a \1", reason)


def _distribution(values: pd.Series) -> dict | None:
    values = values.dropna().astype(float)
    if values.empty:
        return None
    return {"n": len(values), **values.agg(["mean", "median", "min", "max"]).to_dict()}
