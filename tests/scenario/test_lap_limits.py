"""What --limits says."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.common.errors import UserError
from airrace.scenario.lap_limits import parse_limits, speed_scale_end

positive = st.floats(0.1, 1e6)


def test_words():
    assert parse_limits("original") == (20.0, 10.0)
    assert parse_limits("rotor") == (math.inf, math.inf)


def test_colours_of_speeds_end_at_the_limit_if_there_is_one():
    assert [speed_scale_end(text) for text in ("original", "v=15,a=8")] == [20.0, 15.0]
    assert speed_scale_end("rotor") == speed_scale_end("a=8") == 50.0


@given(positive, positive)
def test_numbers(v, a):
    assert parse_limits(f"v={v!r},a={a!r}") == parse_limits(f" a = {a!r} , v={v!r}") == (v, a)
    assert parse_limits(f"v={v!r}") == (v, math.inf)
    assert parse_limits(f"a={a!r}") == (math.inf, a)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "fast",
        "v",
        "v=",
        "v=x",
        "v=0",
        "v=0.09",
        "a=1e-9",
        "v=-1",
        "v=nan",
        "v=inf",
        "v=1,v=2",
        "v=1;a=2",
        "s=1",
        "20,10",
        "Rotor",
        "v=1,a=2,",
        "v==1",
    ],
)
def test_anything_else_is_one_clear_error(text):
    with pytest.raises(UserError, match="--limits") as e:
        parse_limits(text)
    message = str(e.value)
    assert f"'{text}'" in message and "v=15,a=8" in message and "\n" not in message
