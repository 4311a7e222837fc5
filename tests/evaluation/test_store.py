import json
import os
import subprocess
import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from airrace.common.errors import UserError
from airrace.common.resources import models_path
from airrace.evaluation.store import RaceStore, first_difference
from tests.evaluation.rows import SETTINGS, row


def stored(folder):
    return [json.loads(line) for line in (folder / "races.jsonl").read_text().splitlines()]


def opened(folder, settings=SETTINGS, resume=False):
    return RaceStore(folder, settings, resume=resume)


def test_keeps_rows_in_the_order_of_their_seeds(tmp_path):
    with opened(tmp_path) as store:
        for seed in (2, 0, 3):
            store.append(row(seed))
            assert stored(tmp_path)[-1] == row(seed)  # at once
        assert [r["seed"] for r in store.rows] == [0, 2, 3]
    with opened(tmp_path, resume=True) as store:
        assert store.rows == [row(0), row(2), row(3)] and store.keys == {0, 2, 3}


def test_none_counts_twice(tmp_path):
    with opened(tmp_path) as store:
        store.append(row(1))
        with pytest.raises(ValueError, match="seed 1 has ended before"):
            store.append(row(1))
    with open(tmp_path / "races.jsonl", "a") as file:
        file.write(json.dumps(row(1, finished=False)) + "\n")
    with opened(tmp_path, resume=True) as store:
        assert store.rows == [row(1)]


@settings(max_examples=40)
@given(data=st.data(), n=st.integers(0, 4))
def test_a_torn_last_line_is_flown_again(tmp_path_factory, data, n):
    """Wherever the file ends, whole lines are kept, and what is written next is whole."""
    folder = tmp_path_factory.mktemp("torn")
    with opened(folder) as store:
        for seed in range(n):
            store.append(row(seed))
    path = folder / "races.jsonl"
    content = path.read_bytes()
    size = data.draw(st.integers(0, len(content)))
    path.write_bytes(content[:size])
    whole = content[:size].count(b"\n")
    with opened(folder, resume=True) as store:
        assert store.keys == set(range(whole))
        for seed in range(whole, n):
            store.append(row(seed))
    assert path.read_bytes() == content


@settings(max_examples=40)
@given(garbage=st.binary(min_size=1, max_size=30))
def test_garbage_at_the_end_is_cut_off(tmp_path_factory, garbage):
    folder = tmp_path_factory.mktemp("garbage")
    garbage = garbage.replace(b"\n", b"") + b"!"
    with opened(folder) as store:
        store.append(row(7))
    with open(folder / "races.jsonl", "ab") as file:
        file.write(garbage)
    with opened(folder, resume=True) as store:
        assert store.rows == [row(7)]
    assert stored(folder) == [row(7)]


def test_a_bad_line_in_the_middle_is_named(tmp_path):
    with opened(tmp_path) as store:
        store.append(row(0))
    path = tmp_path / "races.jsonl"
    path.write_text("nonsense\n" + path.read_text())
    with pytest.raises(UserError, match="Line 1 of .*races.jsonl is not the row"):
        opened(tmp_path, resume=True)
    assert path.read_text().startswith("nonsense\n")
    broken = row(0) | {"result": row(0)["result"] | {"laps": [{"time_s": "quick"}]}}
    path.write_text(json.dumps(broken) + "\n")
    with pytest.raises(UserError, match="Line 1 of .*: result.laps.0..*; remove the line"):
        opened(tmp_path, resume=True)


class TestResume:
    def test_only_when_asked(self, tmp_path):
        with opened(tmp_path) as store:
            store.append(row(0))
        before = (tmp_path / "races.jsonl").read_bytes()
        with pytest.raises(UserError, match="already holds an evaluation; go on .* --resume"):
            opened(tmp_path)
        assert (tmp_path / "races.jsonl").read_bytes() == before

    @pytest.mark.parametrize(
        "change, words",
        [
            ({"tracks": 5}, "with tracks 4, not 5"),
            (
                {"scenario": {**SETTINGS["scenario"], "referee": {"margin": 1.0}}},
                "with scenario.referee.margin 60.0, not 1.0",
            ),
            ({"new": 1}, "with new nothing, not 1"),
        ],
    )
    def test_other_settings_are_refused(self, tmp_path, change, words):
        with opened(tmp_path) as store:
            store.append(row(0))
        with pytest.raises(UserError, match=words):
            opened(tmp_path, {**SETTINGS, **change}, resume=True)

    def test_nothing_to_resume_is_a_start(self, tmp_path):
        with opened(tmp_path, resume=True) as store:
            store.append(row(0))
        assert json.loads((tmp_path / "evaluation.json").read_text())["settings"] == SETTINGS

    def test_rows_of_unknown_settings_are_refused(self, tmp_path):
        with opened(tmp_path) as store:
            store.append(row(0))
        (tmp_path / "evaluation.json").unlink()
        with pytest.raises(UserError, match="evaluation.json is missing"):
            opened(tmp_path, resume=True)
        (tmp_path / "evaluation.json").write_text("[]")
        with pytest.raises(UserError, match="is no file with the settings of an evaluation"):
            opened(tmp_path, resume=True)


def test_one_process_at_a_time(tmp_path):
    code = (
        "import sys; from pathlib import Path\n"
        "from airrace.evaluation.store import RaceStore\n"
        "from tests.evaluation.rows import SETTINGS\n"
        "RaceStore(Path(sys.argv[1]), SETTINGS, resume=True)\n"
    )

    def other():
        root = str(models_path().parent)
        return subprocess.run(
            [sys.executable, "-c", code, tmp_path],
            capture_output=True,
            text=True,
            cwd=root,
            env={**os.environ, "PYTHONPATH": root},
        )

    with opened(tmp_path):
        assert "Another evaluation is writing to" in other().stderr
    assert other().returncode == 0


def test_nothing_is_left_of_an_evaluation_that_could_not_begin(tmp_path):
    with pytest.raises(UserError), opened(tmp_path):
        raise UserError("no scheduler")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(UserError), opened(tmp_path) as store:
        store.append(row(0))
        raise UserError("refused")
    with pytest.raises(UserError), opened(tmp_path, resume=True):
        raise UserError("no scheduler")
    assert stored(tmp_path) == [row(0)]


def test_a_full_disk(tmp_path, monkeypatch):
    """What cannot be written whole is not there, and is not counted."""

    def full(descriptor):
        raise OSError(28, "No space left on device")

    with opened(tmp_path) as store:
        store.append(row(0))
        fsync = os.fsync
        calls = iter([full])
        monkeypatch.setattr(os, "fsync", lambda d: next(calls, fsync)(d))
        with pytest.raises(UserError, match="No space left on device.*--resume"):
            store.append(row(1))
        assert store.keys == {0}
    assert stored(tmp_path) == [row(0)]


def test_first_difference():
    assert first_difference({"a": [1], "b": {"c": 2}}, {"b": {"c": 2}, "a": [1]}) is None
    assert first_difference({"b": {"c": 2}}, {"b": {"c": 3}}) == ("b.c", 2, 3)
    assert str(first_difference({"b": 1}, {})) == "('b', 1, nothing)"
    assert first_difference({"b": 1}, {"b": True}) == ("b", 1, True)
    assert first_difference({"b": [{"c": 2}]}, {"b": [{"c": 3}]}) == ("b[0].c", 2, 3)
    assert str(first_difference([1], [1, 2])) == "('[1]', nothing, 2)"
