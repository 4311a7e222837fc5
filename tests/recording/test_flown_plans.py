import pytest

from airrace.recording.flown_plans import plan_of_laps, same_plan_words


def _laps(*plans):
    """Laps of a race.json that flew plans of these numbers; None: no plan."""
    return [
        {"lap": k, "plan": None if plan is None else {"number": plan, "duration_s": 8.0}}
        for k, plan in enumerate(plans, start=1)
    ]


@pytest.mark.parametrize(
    "plans, expected",
    [((), {}), ((1, 2, 2, 3), {1: 1, 2: 2, 3: 2, 4: 4}), ((None, 1, None), {2: 2})],
)
def test_a_plan_is_named_by_the_first_lap_that_flew_it(plans, expected):
    assert plan_of_laps(_laps(*plans)) == expected


@pytest.mark.parametrize(
    "plans, words",
    [
        ({}, ""),
        ({1: 1, 2: 2}, ""),
        ({1: 1, 2: 1}, "Lap 2 flew the plan of lap 1."),
        ({1: 1, 2: 1, 3: 1}, "Laps 2 and 3 flew the plan of lap 1."),
        ({1: 1, 2: 2} | dict.fromkeys(range(3, 11), 2), "Laps 3 to 10 flew the plan of lap 2."),
        (
            {1: 1, 2: 1, 3: 3, 4: 3, 5: 3, 6: 3, 9: 3},
            "Lap 2 flew the plan of lap 1; laps 4 to 6 and 9 flew the plan of lap 3.",
        ),
    ],
)
def test_who_flew_whose_plan_in_words(plans, words):
    assert same_plan_words(plans) == words
