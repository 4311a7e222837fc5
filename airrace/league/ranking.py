"""Who is before whom, and why: finish rates in steps first, then the mean lap.

The fastest of many tries says little, and rewards who gambles. So the lower end of the finish
rate's interval comes first: it is what an entry can be trusted with. It is rounded down to steps,
so that one lucky race more does not decide; within a step, speed does.
"""

import dataclasses as dc
import math
from collections.abc import Sequence

from airrace.evaluation.summary import wilson_interval

_ROUNDING = 1e-9  # of steps: an end that lies on one counts as reached


@dc.dataclass(frozen=True)
class Standing:
    """One line of the ranking."""

    place: int  # from 1; equal for those that are equal
    entry: str  # its name
    races: int  # that it has flown
    finished: int  # how many of them it finished
    # rate_low, rate_high: the 95 % interval (Wilson) of its finish rate
    rate_low: float
    rate_high: float
    step: float  # rate_low, rounded down to a multiple of the season's rate_step
    # Mean of its mean laps over the races that all entries of its step finished, if there is one,
    # else over those that it finished itself (s); None without
    mean_lap_s: float | None
    common: int  # number of those races
    best_lap_s: float | None  # its quickest lap (s), None without one; it does not count


def rank(entries: Sequence[str], flights: Sequence[dict], rate_step: float) -> list[Standing]:
    """Returns the ranking, the best first.

    Args:
        flights: lines of league.json: ``entry``, ``leg``, ``finished``, ``mean_lap_s`` and
            ``best_lap_s``.
    """
    own = {name: [each for each in flights if each["entry"] == name] for name in entries}
    laps = {
        name: {each["leg"]: each["mean_lap_s"] for each in own[name] if each["finished"]}
        for name in entries
    }
    drafts = {name: _draft(name, own[name], rate_step) for name in entries}
    for step in {draft.step for draft in drafts.values()}:
        members = [name for name in entries if drafts[name].step == step and laps[name]]
        common = set.intersection(*({*laps[name]} for name in members)) if members else set()
        for name in members:
            counted = common or {*laps[name]}
            mean = sum(laps[name][leg] for leg in sorted(counted)) / len(counted)
            drafts[name] = dc.replace(drafts[name], mean_lap_s=mean, common=len(counted))
    ordered = sorted(drafts.values(), key=lambda each: (_merit(each), each.entry))
    merits = [_merit(each) for each in ordered]
    return [dc.replace(each, place=merits.index(merit) + 1) for each, merit in zip(ordered, merits)]


def round_down(rate: float, step: float) -> float:
    """Returns the largest multiple of a step that a rate reaches."""
    return math.floor(rate / step + _ROUNDING) * step


def _merit(standing: Standing) -> tuple[float, float]:
    """Returns what is compared: less is better."""
    return -standing.step, math.inf if standing.mean_lap_s is None else standing.mean_lap_s


def _draft(name: str, own: Sequence[dict], rate_step: float) -> Standing:
    """Returns the line of an entry by its own races alone."""
    finished = sum(flight["finished"] for flight in own)
    low, high = wilson_interval(finished, len(own))
    bests = [flight["best_lap_s"] for flight in own if flight["best_lap_s"] is not None]
    return Standing(
        place=0,
        entry=name,
        races=len(own),
        finished=finished,
        rate_low=low,
        rate_high=high,
        step=round_down(low, rate_step),
        mean_lap_s=None,
        common=0,
        best_lap_s=min(bests, default=None),
    )
