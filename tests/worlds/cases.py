"""Cases of a test that is run with several."""

from collections.abc import Iterable

import pytest
from hypothesis import settings

# Of what text and bytes from outside may be, as many examples by default as with --all.
guarded = settings(max_examples=max(100, settings.default.max_examples))


def first(cases: Iterable, count: int = 1) -> list:
    """Returns cases for pytest.mark.parametrize, all but the first only for --all.

    Args:
        cases: values, or tuples of values if a test has several parameters.
        count: how many are run in any case.
    """
    return [
        case if i < count else pytest.param(*_values(case), marks=pytest.mark.repeats)
        for i, case in enumerate(cases)
    ]


def _values(case) -> tuple:
    return case if isinstance(case, tuple) else (case,)
