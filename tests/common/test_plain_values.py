"""What Python code hands over: as good as YAML's, or one sentence."""

import dataclasses as dc
from pathlib import Path

import numpy as np
import pytest

from airrace.common.errors import UserError
from airrace.common.plain_values import make_plain, plain, plain_tree, whole_number


@dc.dataclass
class Part:
    """A part of a config."""

    rate: float = 1.0


@dc.dataclass
class Config:
    """Fields of every kind."""

    laps: int = 1
    name: str = ""
    on: bool = True
    most: float | None = None
    parts: list[Part] = dc.field(default_factory=lambda: [Part()])
    mean: list[float] = dc.field(default_factory=list)
    systems: dict[str, str] = dc.field(default_factory=dict)


def test_what_is_as_good():
    config = Config(
        laps=np.float64(3.0),
        name=Path("a") / "b",
        on=np.bool_(False),
        most=np.float32(0.5),
        parts=[Part(np.int64(2))],
        mean=np.array([1.0, 2.0]),
        systems={"explorer": "a:b"},
    )
    make_plain(config)
    assert config == Config(3, "a/b", False, 0.5, [Part(2.0)], [1.0, 2.0], {"explorer": "a:b"})
    kinds = [type(value) for value in (config.laps, config.on, config.most, config.parts[0].rate)]
    assert kinds == [int, bool, float, float]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (dict(laps=1.5), "laps must be a whole number, not 1.5"),
        (dict(laps=True), "laps must be a whole number, not True"),
        (dict(laps=float("nan")), "laps must be a whole number, not nan"),
        (dict(laps="3"), "laps must be a whole number, not '3'"),
        (dict(laps=None), "laps must be a whole number, not None"),
        (dict(name=b"track"), "name must be text in quotes"),
        (dict(on=1), "on must be true or false, not 1"),
        (dict(most=[1.0]), "most must be a number"),
        (dict(most=1j), "most must be a number"),
        (dict(parts=[Part("fast")]), r"parts\[0\].rate must be a number, not 'fast'"),
        (dict(parts=[{}]), r"parts\[0\] must be a Part"),
        (dict(mean=3.0), "mean must be a list"),
        (dict(systems=["a"]), "systems must be a dict"),
    ],
)
def test_what_is_not(change, said):
    with pytest.raises(UserError, match=said):
        make_plain(Config(**change))


def test_whole_numbers_of_a_range():
    assert whole_number("gates", np.int8(3), 1, 20) == 3
    with pytest.raises(UserError, match="gates must be a whole number from 1 to 20, not 21"):
        whole_number("gates", 21, 1, 20)
    with pytest.raises(UserError, match="count must be a whole number from 1 on, not 0"):
        whole_number("count", 0, 1)
    assert plain("rate", float, 3) == 3.0


def test_trees_of_values():
    tree = {"a": [np.int64(1), np.array(2.5), Path("b")], "c": {"d": (np.bool_(True), None)}}
    tree["e"] = np.array([[1.0], [2.0]])
    assert plain_tree("it", tree) == {
        "a": [1, 2.5, "b"],
        "c": {"d": [True, None]},
        "e": [[1.0], [2.0]],
    }
    with pytest.raises(UserError, match=r"it\['a'\]\[1\] must be a number, text, a list or a dict"):
        plain_tree("it", {"a": [1, {2}]})


def test_numbers_beyond_all_floats():
    with pytest.raises(UserError, match="a must be a whole number from 0 on"):
        whole_number("a", 10**400, 0)
    with pytest.raises(UserError, match="a must be a number"):
        plain("a", float, 10**400)
