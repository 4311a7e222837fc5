from typing import Literal, NotRequired, TypedDict

import pytest

from airrace.common.errors import UserError
from airrace.common.json_files import parse_json, read_json


class Lap(TypedDict):
    time_s: float
    name: NotRequired[str]


class Race(TypedDict):
    laps: list[Lap]
    seed: int
    best: float | None
    kind: Literal["a", "b"]
    rest: dict[str, object]


GOOD = '{"laps": [{"time_s": 1}], "seed": 3, "best": null, "kind": "a", "rest": {"x": [1]}, "y": 2}'
BAD = {
    '"time_s": 1': {
        '"time_s": "1"': 'laps[0].time_s is "1", expected a number',
        '"time_s": true': "laps[0].time_s is true, expected a number",
        '"time": 1': "laps[0].time_s is missing",
        '"time_s": NaN': "JSON has no NaN",
        '"time_s": -Infinity': "JSON has no -Infinity",
        '"time_s": 1e999': "a number is too large",
        '"time_s": 1' + 400 * "0": "a number is too large",
        '"time_s": 1' + 40 * "0": "expected a number",
        '"time_s": 1, "name": 2': "laps[0].name is 2, expected a text",
        '"time_s": 1, "z": "\\ud800"': "half of a character",
        '"time_s": 1,': "line 1",
    },
    '"seed": 3': {'"seed": 3.5': "seed is 3.5, expected a whole number"},
    '"best": null': {'"best": "x"': 'best is "x", expected a number'},
    '"kind": "a"': {'"kind": "c"': 'kind is "c", expected "a" or "b"'},
    '"rest": {"x": [1]}': {
        '"rest": []': "rest is [], expected an object",
        '"rest": {"x": ' + 100 * "[" + 100 * "]" + "}": "nested too deeply",
        '"rest": ' + 100_000 * "[": "nested too deeply",
    },
    '[{"time_s": 1}]': {"3": "laps is 3, expected a list"},
}


def test_what_fits_is_returned_with_its_other_keys():
    race = parse_json(GOOD, Race)
    assert race["laps"][0]["time_s"] == 1 and race["y"] == 2
    long = GOOD.replace("3", str(2**128))  # a seed
    assert parse_json(long.encode(), Race)["seed"] == 2**128


@pytest.mark.parametrize(
    "old, new, words",
    [(old, new, words) for old, each in BAD.items() for new, words in each.items()],
)
def test_the_first_misfit_is_named(old, new, words):
    assert old in GOOD
    with pytest.raises(ValueError) as e:
        parse_json(GOOD.replace(old, new), Race)
    assert words in str(e.value) and len(str(e.value)) < 200


def test_a_file_is_named_with_its_remedy(tmp_path, monkeypatch):
    path = tmp_path / "race.json"
    path.write_text(GOOD)
    assert read_json(path, Race, "race.json", "name another")["seed"] == 3
    for text, words in ((b"\xff", "no text|not a text in UTF-8"), (b"[]", "it is ., expected an")):
        path.write_bytes(text)
        with pytest.raises(
            UserError, match=f"race.json is no race.json: .*({words}|\\[\\]).*; name"
        ):
            read_json(path, Race, "race.json", "name another")
    with pytest.raises(UserError, match="gone cannot be read .No such file.*; name another"):
        read_json(tmp_path / "gone", Race, "race.json", "name another")
    with open(path, "wb") as file:
        file.truncate(65_000_000)
    with pytest.raises(UserError, match="larger than 64 MB"):
        read_json(path, Race, "race.json", "name another")


def test_a_key_that_is_there_twice_is_refused():
    with pytest.raises(ValueError, match='"a" is there twice in one object'):
        parse_json('{"a": 1, "a": 2}', dict)
