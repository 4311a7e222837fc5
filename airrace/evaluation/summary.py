"""What the races of an evaluation amount to."""

import collections
import math
import re

import numpy as np

_Z_95 = 1.959963984540054  # the 97.5 % quantile of the standard normal distribution


def wilson_interval(successes: int, trials: int, z: float = _Z_95) -> tuple[float, float]:
    """Returns the Wilson score interval of a success rate, by default of 95 %.

    E. B. Wilson, "Probable inference, the law of succession, and statistical
    inference", J. Am. Stat. Assoc. 22 (1927), 209-212. Unlike the one from the
    normal approximation it is sensible for few trials and for rates of 0 and 1.

    Args:
        successes, trials: numbers; 0 <= successes <= trials.
        z: quantile of the standard normal distribution.
    """
    if trials == 0:
        return 0.0, 1.0
    rate = successes / trials
    centre = rate + z**2 / (2 * trials)
    half = z * math.sqrt(rate * (1 - rate) / trials + z**2 / (4 * trials**2))
    low, high = ((centre + side * half) / (1 + z**2 / trials) for side in (-1, 1))
    # Exact where rounding errors would say otherwise.
    return (0.0 if successes == 0 else low), (1.0 if successes == trials else high)


def race_line(row: dict) -> dict:
    """Returns the numbers of one race from its row, see fly(); no wall times.

    ``exploration_s`` is None unless the loop was closed. ``map_rms_m`` is of the
    end of the last lap; None without a lap.
    """
    result = row["result"]
    exploration, laps = result["exploration"], result["laps"]
    return {
        "seed": row["seed"],
        "gates": row["gates"],
        "length_m": row["length_m"],
        "finished": result["finished"],
        "dnf_reason": result["dnf_reason"],
        "explored": exploration["success"],
        "exploration_s": exploration["time_s"] if exploration["success"] else None,
        "gates_found": exploration["gates_found"],
        "lap_times_s": [lap["time_s"] for lap in laps],
        "mean_lap_s": result["mean_lap_s"],
        "best_lap_s": result["best_lap_s"],
        "map_rms_m": laps[-1]["map_rms_m"] if laps else None,
        "collisions": result["collisions"],
    }


def summarize(lines: list[dict]) -> dict:
    """Returns the numbers of many races.

    Distributions are ``n``, ``mean``, ``median``, ``min`` and ``max``, or None
    if there is nothing to tell. Lap times and speeds are over all complete laps.

    Args:
        lines: see race_line().
    """
    finished = sum(line["finished"] for line in lines)
    laps = [(line["length_m"], time) for line in lines for time in line["lap_times_s"]]
    reasons = collections.Counter(
        dnf_class(line["dnf_reason"]) for line in lines if not line["finished"]
    )
    return {
        "races": len(lines),
        "finished": finished,
        "finish_rate": finished / len(lines) if lines else None,
        "finish_rate_95": list(wilson_interval(finished, len(lines))),
        "explored": sum(line["explored"] for line in lines),
        "exploration_s": _distribution(line["exploration_s"] for line in lines),
        "lap_s": _distribution(time for _, time in laps),
        "lap_speed": _distribution(length / time for length, time in laps),
        "map_rms_m": _distribution(line["map_rms_m"] for line in lines),
        "collisions": sum(line["collisions"] for line in lines),
        "dnf_reasons": dict(sorted(reasons.items(), key=lambda item: (-item[1], item[0]))),
    }


def dnf_class(reason: str) -> str:
    """Returns a reason without numbers and what led to it: reasons to be counted."""
    reason = re.sub(r"^(ran out of time in state \w+):.*", r"\1", reason)
    return re.sub(r"\b(pylon|board)_\w+", r"a \1", reason)


def _distribution(values) -> dict | None:
    values = [value for value in values if value is not None]
    if not values:
        return None
    return {
        "n": len(values),
        "mean": float(np.mean(values)),
        "median": float(np.median(values)),
        "min": min(values),
        "max": max(values),
    }
