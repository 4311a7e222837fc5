import dataclasses as dc
import re
import shutil

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.yaml import yaml_load_typed

import airrace.common.resources
from airrace.common.errors import UserError
from airrace.common.resources import find_yaml, load_yaml, models_path
from airrace.common.words import printable
from tests.worlds.cases import guarded


@dc.dataclass
class Inner:
    speed: float = 1.0
    count: int = 2


@dc.dataclass
class Schema:
    name: str = "a"
    fast: bool = True
    inner: Inner = dc.field(default_factory=Inner)
    numbers: list[float] = dc.field(default_factory=list)
    inners: list[Inner] = dc.field(default_factory=list)
    boxes: dict[str, str] = dc.field(default_factory=dict)


def test_models_are_found_in_the_checkout():
    assert (models_path() / "package.xml").is_file()
    assert find_yaml("tracks", "student-airrace").parent == models_path() / "tracks"


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """airrace's module of resources as if it lay in an empty folder."""
    package = tmp_path / "site-packages" / "airrace"
    package.mkdir(parents=True)
    monkeypatch.setattr(airrace.common.resources, "PACKAGE", package)
    models_path.cache_clear()
    yield package
    models_path.cache_clear()


def test_models_are_found_inside_an_installed_package(elsewhere):
    (elsewhere / "models").mkdir()
    (elsewhere / "models" / "package.xml").touch()
    assert models_path() == elsewhere / "models"


def test_missing_models_are_explained(elsewhere):
    with pytest.raises(UserError, match="install airrace again"):
        models_path()


class TestFindYaml:
    def test_a_file_is_found_by_path(self, tmp_path, monkeypatch):
        (tmp_path / "mine.yaml").touch()
        monkeypatch.chdir(tmp_path)
        for name in (str(tmp_path / "mine.yaml"), "mine.yaml", "./mine.yaml"):
            assert find_yaml("tracks", name).samefile(tmp_path / "mine.yaml")

    def test_a_shipped_name_wins_over_a_file_but_not_over_a_path(self, tmp_path, monkeypatch):
        (tmp_path / "student-airrace").touch()
        monkeypatch.chdir(tmp_path)
        assert find_yaml("tracks", "student-airrace").suffix == ".yaml"
        assert find_yaml("tracks", "./student-airrace").samefile(tmp_path / "student-airrace")

    @pytest.mark.parametrize(
        "name",
        ["", ".", "/", "..", "no-such", "/no/such", "x" * 400, "a\0b", "tracks/student-airrace"],
    )
    def test_what_is_missing_is_named_with_what_there_is(self, tmp_path, monkeypatch, name):
        monkeypatch.chdir(tmp_path)
        with pytest.raises(UserError, match="the shipped tracks are: .*student-airrace") as e:
            find_yaml("tracks", name)
        assert f"no track named '{printable(name)}'" in str(e.value)

    @guarded
    @given(st.text(max_size=40))
    def test_any_name_is_found_or_explained(self, name):
        try:
            assert find_yaml("scenarios", name).is_file()
        except UserError as e:
            assert "the shipped scenarios are: grand_prix, levels, original, races" in str(e)


COMPLAINTS = {
    "{name: 3}": "name must be text in quotes, not 3",
    "{fast: 1}": "fast must be true or false, not 1",
    "{inner: {count: many}}": "inner.count must be a whole number, not 'many'",
    "{inner: {count: 2.5}}": "inner.count must be a whole number, not 2.5",
    "{inner: {count: true}}": "inner.count must be a whole number, not True",
    "{inner: {speed: fast}}": "inner.speed must be a number, not 'fast'",
    "{inner: {speed: null}}": "inner.speed must be a number, not None",
    "{inner: {sped: 3}}": "inner.sped is unknown; there are: speed, count",
    "{innner: {}}": "innner is unknown; there are: name, fast, inner, numbers, inners, boxes",
    "{inner: null}": "inner must be a mapping from names to values, not None",
    "{numbers: 3}": "numbers must be a list in brackets [ ], not 3",
    "{numbers: [1, x]}": "numbers, number 2, must be a number, not 'x'",
    "{inners: [{}, {speed: x}]}": "inner 2: speed must be a number, not 'x'",
    "{boxes: {a: 3}}": "boxes.a must be text in quotes, not 3",
    "{boxes: [3]}": "boxes must be a mapping from names to values, not [3]",
    "[1, 2]": "it must be a mapping from names to values, not [1, 2]",
    "just words": "it must be a mapping from names to values, not 'just words'",
    "3: 4": "3 is unknown; there are: name",
    "{_base: 1, 3: 4}": "3 is unknown; there are: name",
}


@pytest.mark.parametrize("text, words", COMPLAINTS.items())
def test_the_first_misfit_is_named(tmp_path, text, words):
    with pytest.raises(UserError) as e:
        load_yaml(Schema, data=text, what="--option")
    assert str(e.value).startswith(f"--option '{text}' does not fit its schema: {words}")
    (tmp_path / "file.yaml").write_text(text)
    with pytest.raises(UserError) as e:
        load_yaml(Schema, filename=tmp_path / "file.yaml")
    assert str(e.value).startswith(f"{tmp_path}/file.yaml does not fit its schema: {words}")
    assert str(e.value).endswith(".") and "\n" not in str(e.value)


def test_a_child_that_is_missing_is_named_with_what_there_is():
    assert load_yaml(Schema, data="{A: {name: b}}", child_name="A").name == "b"
    with pytest.raises(UserError, match="it has no 'C' at its top level, only: A, B"):
        load_yaml(Schema, data="{A: {}, B: {}}", child_name="C")
    with pytest.raises(UserError, match="it has no 'C' at its top level, only: no keys"):
        load_yaml(Schema, data="[A]", child_name="C")
    with pytest.raises(UserError, match="inner.speed must be a number"):
        load_yaml(Schema, data="A: {inner: {speed: []}}", child_name="A")


def test_what_is_not_yaml_is_named_with_the_line(tmp_path):
    with pytest.raises(UserError, match="--option 'a: 1 b: .1' is not valid YAML at line 2"):
        load_yaml(Schema, data="a: 1\nb: [1", what="--option")
    with pytest.raises(UserError, match="is not valid YAML"):
        load_yaml(Schema, data="name: !!python/object/apply:os.getcwd []")
    with pytest.raises(UserError, match="nested too deeply"):
        load_yaml(Schema, data="[" * 5000 + "]" * 5000)
    path = tmp_path / "picture.yaml"
    path.write_bytes(b"\x89PNG\xff\xfe\x00")
    with pytest.raises(UserError, match="picture.yaml is not a text file"):
        load_yaml(Schema, filename=path)
    with pytest.raises(UserError, match="cannot be read: Is a directory"):
        load_yaml(Schema, filename=tmp_path)


_data = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-9, 9)
    | st.floats()
    | st.text(max_size=4)
    | st.sampled_from(["true", "1", "2.5", "nan", "1e3", "many"]),
    lambda inner: (
        st.lists(inner, max_size=2)
        | st.dictionaries(
            st.sampled_from([f.name for s in (Schema, Inner) for f in dc.fields(s)] + ["_x", 3]),
            inner,
            max_size=3,
        )
    ),
    max_leaves=6,
)


@guarded
@given(_data)
def test_what_drake_refuses_is_refused_in_our_words(data):
    text = yaml.safe_dump(data)
    try:
        expected = yaml_load_typed(schema=Schema, data=text)
    except Exception:
        expected = None
    try:
        # By repr(): NaN is not equal to itself.
        assert repr(load_yaml(Schema, data=text)) == repr(expected)
    except UserError as e:
        assert expected is None and "\n" not in str(e)
        # In our words, not in Drake's, which leave out where it is.
        assert re.search(" (must be|is unknown; there are:) ", str(e))


def test_a_file_that_appears_is_found(tmp_path, monkeypatch):
    """Nothing but the place of models/ is remembered."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError):
        find_yaml("tracks", "mine.yaml")
    shutil.copy(find_yaml("tracks", "student-airrace"), "mine.yaml")
    assert find_yaml("tracks", "mine.yaml").is_file()
