import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from airrace.common import held_folders
from airrace.common.files import results_folder
from airrace.common.held_folders import held, remove_abandoned, temporary_folder

PROGRAM = """
import os, sys, tempfile
from airrace.common.held_folders import temporary_folder
with temporary_folder() as folder:
    (folder / "file").touch()
    print(folder, flush=True)
    sys.stdin.read()
"""
LONG_AGO = time.time() - 1000.0


@pytest.fixture(autouse=True)
def temporary(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    return tmp_path


def old(folder):
    folder.mkdir(exist_ok=True)
    os.utime(folder, (LONG_AGO, LONG_AGO))
    return folder


def test_a_temporary_folder_is_removed_with_all_that_is_in_it(temporary):
    with pytest.raises(KeyError), temporary_folder() as folder:
        (folder / "a").mkdir()
        raise KeyError
    assert list(temporary.iterdir()) == []


def test_what_a_killed_process_left_is_removed_by_the_next_one():
    command = [sys.executable, "-c", PROGRAM]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes) as process:
        left = old(Path(process.stdout.readline().strip()))
        with temporary_folder():
            assert (left / "file").exists()  # its process lives
        process.kill()
    assert left.exists()
    with temporary_folder() as folder:
        assert not left.exists() and folder.exists()


def test_others_are_left_alone(temporary, monkeypatch):
    new, mine = temporary / "airrace-held-new", temporary / "airrace-held-mine"
    new.mkdir()
    elsewhere = old(temporary / "elsewhere")
    (temporary / "airrace-held-link").symlink_to(elsewhere)
    (temporary / "airrace-held-file").touch()
    with temporary_folder():
        pass
    assert new.exists() and elsewhere.exists()
    monkeypatch.setattr(held_folders.os, "getuid", lambda: os.geteuid() + 1)
    old(mine)
    with temporary_folder():
        assert mine.exists()


def test_empty_results_of_killed_races_are_removed(temporary):
    runs = temporary / "runs"
    runs.mkdir()
    left, empty, mine, used = (
        old(runs / name)
        for name in ("20260101T000000Z-a", "empty", "20260101T000000Z-b", "20260101T000000Z-c")
    )
    (used / "race.json").touch()
    os.utime(used, (LONG_AGO, LONG_AGO))
    with held(mine), results_folder(runs / "20260101T000001Z-d", numbered=True) as folder:
        assert folder.exists()
    assert not left.exists() and empty.exists() and mine.exists() and used.exists()


def test_what_cannot_be_removed_stays(temporary):
    def fail(folder):
        raise OSError

    remove_abandoned([old(temporary / "a"), temporary / "not there"], fail)
