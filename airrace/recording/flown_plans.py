"""Which laps of a race flew the same plan, and how to say so."""

from collections.abc import Iterable, Mapping


def plan_of_laps(laps: Iterable[Mapping]) -> dict[int, int]:
    """Returns which plan every lap flew, named by the first lap that flew it.

    Args:
        laps: of a race.json. Those without a plan are left out.
    """
    first: dict[int, int] = {}  # by the number of the plan
    return {
        lap["lap"]: first.setdefault(lap["plan"]["number"], lap["lap"])
        for lap in laps
        if lap.get("plan") is not None
    }


def same_plan_words(plans: Mapping[int, int]) -> str:
    """Returns a sentence on laps that flew an earlier lap's plan; '' if none did.

    Such as ``Laps 3 to 10 flew the plan of lap 2.``

    Args:
        plans: the lap that a lap's plan was first flown on, by lap; see plan_of_laps().
    """
    clauses = []
    for first in sorted(set(plans.values())):
        if again := sorted(lap for lap, plan in plans.items() if plan == first != lap):
            noun = "lap" if len(again) == 1 else "laps"
            clauses.append(f"{noun} {_ranges(again)} flew the plan of lap {first}")
    if not clauses:
        return ""
    sentence = "; ".join(clauses) + "."
    return sentence[0].upper() + sentence[1:]


def _ranges(numbers: list[int]) -> str:
    """Returns numbers in words, those that follow one another as a range: ``1, 3 to 5 and 9``."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    words = []
    for run in runs:
        # Two in a row are no range.
        words += [f"{run[0]} to {run[-1]}"] if len(run) > 2 else [str(number) for number in run]
    return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]]))
