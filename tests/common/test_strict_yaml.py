"""What two versions of YAML read in two ways is refused, with its line; all else is not."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.yaml import yaml_dump

from airrace.common.errors import UserError
from airrace.common.resources import models_path
from airrace.common.strict_yaml import plain_data, read_yaml
from airrace.scenario import load_scenario
from airrace.track import load_track

UNCLEAR = ["010", "-017", "1:30", "190:20:30.15", "1_000", "1_0.5", "1_000e3", "0b101"]
WORDS = ["yes", "No", "on", "OFF", "2026-11-29"]


@pytest.mark.parametrize("text", UNCLEAR + WORDS)
@pytest.mark.parametrize("form", ["a: 1\nb: {}", "a: 1\nb: [2, {}]", "a: 1\n{}: 2"])
def test_what_has_two_meanings_is_refused_with_its_line(text, form):
    with pytest.raises(UserError) as error:
        read_yaml("mine.yaml", data=form.format(text))
    said = str(error.value)
    assert said.startswith(f"mine.yaml is not clear at line 2: '{text}' means one thing")
    assert said.endswith("a text in quotes.")
    quoted = form.format(f"'{text}'")
    assert read_yaml("mine.yaml", data=quoted) == quoted


@pytest.mark.parametrize(
    "text",
    [
        "10",
        "-3",
        "0",
        "0x1F",
        "1.5",
        "-.5",
        "1e3",
        "2.0e-05",
        ".inf",
        "-.inf",
        ".nan",
        "true",
        "False",
    ]
    + [
        "null",
        "~",
        "",
        "a:b",
        "my_team:make",
        "a_1",
        "08",
        "n",
        "y",
        "1.2.3",
        "runs/1_2",
        "v=15,a=8",
    ],
)
def test_what_has_one_meaning_is_not(text):
    assert read_yaml("mine.yaml", data=f"a: {text}")


def test_of_equal_keys_the_second_is_named():
    for data in ("seed: 1\nlaps: 2\nseed: 3", "a:\n  b: 1\nc:\n  - {x: 1,\n x: 2}"):
        with pytest.raises(UserError, match="mine is not clear at line [35]: there is another '"):
            read_yaml("mine", data=data)
    assert read_yaml("mine", data="a: {x: 1}\nb: {x: 1}\nc: [x, x]")


def test_aliases_of_aliases_take_no_time():
    lines = ["a0: &a0 [1]"] + [
        f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 40)
    ]
    with pytest.raises(UserError, match="stands for far more by its aliases"):
        read_yaml("mine", data="\n".join(lines))
    read_yaml("mine", data="\n".join(lines[:4]))


@given(
    st.dictionaries(
        st.text(max_size=5),
        st.text(max_size=8)
        | st.integers()
        | st.floats(allow_nan=False)
        | st.booleans()
        | st.none(),
        max_size=4,
    )
)
def test_what_is_dumped_can_be_read(data):
    assert plain_data(read_yaml("mine", data=yaml_dump(data))) == data


def test_all_shipped_files_are_clear():
    for path in models_path().rglob("*.yaml"):
        read_yaml(str(path), filename=path)


def test_it_is_so_wherever_yaml_is_read(tmp_path):
    with pytest.raises(UserError, match="--scenario_text .* at line 1: '010'"):
        load_scenario(scenario_text="seed: 010")
    path = tmp_path / "mine.yaml"
    path.write_text("Defaults:\n  laps: 1\n  laps: 2\n")
    with pytest.raises(
        UserError, match=r"mine.yaml is not clear at line 3: there is another 'laps'"
    ):
        load_scenario(filename=str(path))
    text = (models_path() / "tracks" / "hexagon.yaml").read_text("utf-8")
    path.write_text(text + "\nname: again\n")
    with pytest.raises(UserError, match="mine.yaml is not clear at line .*another 'name'"):
        load_track(path)


@pytest.mark.parametrize("text", ["a: 9" + "9" * 5000, 'a: !!int ""', 'a: !!int "010"'])
def test_numbers_that_are_none_are_a_sentence(text):
    with pytest.raises(UserError, match="at line 1"):
        read_yaml("a.yaml", data=text)
