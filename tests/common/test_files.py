import concurrent.futures
import json
import os
import threading
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.common.errors import UserError
from airrace.common.files import digest, read_regular, results_folder, write_json, write_text


def test_a_reader_sees_the_old_text_or_the_new_one(tmp_path):
    path = tmp_path / "text"
    texts = ["a" * 200_000, "b" * 200_000]
    write_text(path, texts[0])
    done = threading.Event()

    def write():
        for k in range(100):
            write_text(path, texts[k % 2])
        done.set()

    threading.Thread(target=write).start()
    while not done.is_set():
        assert path.read_text() in texts
    assert [p.name for p in tmp_path.iterdir()] == ["text"]


@pytest.mark.parametrize("step", ["write_bytes", "replace"])
@pytest.mark.parametrize(
    "error", [OSError(28, "No space left on device"), KeyboardInterrupt()], ids=["full", "Ctrl-C"]
)
def test_a_write_that_fails_leaves_the_old_text_alone(tmp_path, monkeypatch, step, error):
    path = tmp_path / "race.json"
    write_text(path, "old")

    def fail(self, *args, **kwargs):
        if step == "write_bytes":
            open(self, "w").close()  # as far as it got
        raise error

    monkeypatch.setattr(Path, step, fail)
    with pytest.raises((UserError, KeyboardInterrupt)) as e:
        write_text(path, "new")
    monkeypatch.undo()
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["race.json"]
    if isinstance(error, OSError):
        assert e.type is UserError
        assert str(path) in str(e.value) and "No space left" in str(e.value)


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(UserError, match="none/text cannot be written"):
        write_text(tmp_path / "none" / "text", "")


def test_a_pipe_is_no_file(tmp_path):
    """Nobody waits for who might write it."""
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path, Path("/dev/zero")):
        with pytest.raises(OSError):
            read_regular(path, 9)
    (tmp_path / "file").write_bytes(b"0123456789")
    assert read_regular(tmp_path / "file", 9) == b"012345678"


def test_text_is_utf8_whatever_the_locale(tmp_path, monkeypatch):
    monkeypatch.setattr("locale.getencoding", lambda: "ascii")
    write_text(tmp_path / "text", "Nürburgring")
    assert (tmp_path / "text").read_bytes() == "Nürburgring".encode()


_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4)
    ),
    max_leaves=10,
)


def load_strict(path):
    """Loads JSON as it is defined: json.loads also takes NaN."""

    def refuse(word):
        raise AssertionError(f"{word} is not JSON")

    return json.loads(Path(path).read_text(), parse_constant=refuse)


@given(_values)
def test_json_is_strict_and_loses_only_what_it_lacks(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "data.json"
    write_json(path, data)
    python = json.dumps(data)  # which writes NaN and Infinity
    assert load_strict(path) == json.loads(python, parse_constant=lambda word: None)


class TestResultsFolder:
    def test_creates_the_folder_and_its_parents(self, tmp_path):
        with results_folder(tmp_path / "a" / "b c") as folder:
            assert folder.is_dir() and not list(folder.iterdir())
        assert folder == tmp_path / "a" / "b c" and folder.is_dir()

    @pytest.mark.parametrize("error", [UserError("bad"), KeyboardInterrupt()])
    def test_bad_input_leaves_no_trace(self, tmp_path, error):
        with pytest.raises(type(error)), results_folder(tmp_path / "a" / "b"):
            raise error
        assert not list(tmp_path.iterdir())

    def test_what_was_there_or_was_left_stays(self, tmp_path):
        (tmp_path / "mine").mkdir()
        with pytest.raises(UserError), results_folder(tmp_path / "mine"):
            raise UserError("bad")
        assert (tmp_path / "mine").is_dir()
        with pytest.raises(UserError), results_folder(tmp_path / "a" / "b") as folder:
            write_text(folder / "race.json", "")
            raise UserError("disk full")
        assert (tmp_path / "a" / "b" / "race.json").is_file()

    def test_two_runs_at_once_never_share_a_folder(self, tmp_path):
        barrier = threading.Barrier(8)

        def claim(_):
            barrier.wait()
            with results_folder(tmp_path / "runs" / "now", numbered=True) as folder:
                return folder.name

        with concurrent.futures.ThreadPoolExecutor(8) as pool:
            names = sorted(pool.map(claim, range(8)))
        assert names == sorted(["now", *(f"now-{k}" for k in range(2, 9))])

    def test_two_runs_at_once_do_not_write_to_one_folder(self, tmp_path):
        with results_folder(tmp_path / "a", refuse=("race.json",)) as folder:
            with pytest.raises(UserError, match="a is written to by another program; name another"):
                with results_folder(folder, refuse=("race.json",)):
                    pytest.fail("the folder was taken")
        with results_folder(folder, refuse=("race.json",)):  # nobody holds it any more
            pass

    @pytest.mark.parametrize("name", ["race.json", "scenario.yaml"])
    def test_an_old_race_is_not_overwritten(self, tmp_path, name):
        (tmp_path / name).write_text("old")
        with pytest.raises(UserError, match="already holds results"):
            with results_folder(tmp_path, refuse=("scenario.yaml", "race.json")):
                pytest.fail("the folder was taken")
        assert (tmp_path / name).read_text() == "old"

    @pytest.mark.parametrize("numbered", [False, True])
    @pytest.mark.parametrize(
        "path", ["file", "file/below", "/proc/none/out", "/proc/out", "x" * 300, "new/" + "x" * 300]
    )
    def test_an_impossible_place_is_named(self, tmp_path, path, numbered):
        (tmp_path / "file").write_text("mine")
        path = tmp_path / path
        if numbered and path.name == "file":
            pytest.skip("takes file-2")
        with pytest.raises(UserError, match="cannot be written to") as e:
            with results_folder(path, numbered=numbered):
                pytest.fail("the folder was taken")
        assert str(path) in str(e.value)
        assert [p.name for p in tmp_path.iterdir()] == ["file"]
        assert (tmp_path / "file").read_text() == "mine"


def test_digest_tells_names_and_contents_apart(tmp_path):
    for folder, files in {"1": {"a": "bc"}, "2": {"ab": "c"}, "3": {"a": "b", "c": ""}}.items():
        (tmp_path / folder / "x").mkdir(parents=True)
        for name, text in files.items():
            (tmp_path / folder / "x" / name).write_text(text)
    assert len({digest(tmp_path / folder / "x") for folder in "123"}) == 3
