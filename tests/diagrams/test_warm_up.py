"""Compiling before a race."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from unittest import mock

import numba
import pytest

from airrace.common import jit
from airrace.common.files import results_folder
from airrace.common.held_folders import temporary_folder
from airrace.diagrams import warm_up
from airrace.scenario import TRUTH, VIO, Scenario, load_scenario
from tests.worlds.cases import first

PROGRAM = """
import gc, pathlib
from numba.core.dispatcher import Dispatcher
from airrace.diagrams.race import run_race
from airrace.diagrams.warm_up import _PARTS
from airrace.scenario import Scenario

def compiled():
    return {{(each.py_func.__module__, each.py_func.__name__, str(signature))
            for each in gc.get_objects() if isinstance(each, Dispatcher)
            for signature in each.signatures}}

scenario = Scenario(laps=1, estimator={estimator!r})
for part in _PARTS.values():
    part(scenario)
before = compiled()
assert len(before) > 10
scenario.referee.time_limit = 9.0
run = run_race(scenario, pathlib.Path({folder!r}))
assert "gate 2" in run["dnf_reason"], run["dnf_reason"]
for each in sorted(compiled() - before):
    print(*each)
"""


@pytest.mark.slow
@pytest.mark.parametrize("estimator", first([VIO, TRUTH]))
def test_nothing_is_left_to_compile_in_the_race(estimator, tmp_path):
    program = PROGRAM.format(estimator=estimator, folder=str(tmp_path))
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == []


@pytest.fixture
def started(monkeypatch, tmp_path):
    """The processes that are started; their machine code would be kept in another folder."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "machine_code"))
    started, start = [], subprocess.Popen

    def note(*args, **kwargs):
        started.append(start(*args, **kwargs))
        return started[-1]

    monkeypatch.setattr(subprocess, "Popen", note)
    return started


@pytest.mark.slow
def test_other_processes_compile_the_first_time(started, capsys):
    scenario = load_scenario(
        scenario_text="{map: track, camera: {renderer: none}, systems: "
        "{trajectory_tracker: 'tests.diagrams.test_warm_up:make_tracker', "
        "geometric_controller: '__main__:only_in_a_script'}}"
    )
    for _ in range(2):  # the second time it has been done
        warm_up.compile_apart(scenario)
        assert [process.returncode for process in started] == [0, 0]
    assert jit.is_complete(TRUTH) and not jit.is_complete(VIO)
    line = "Compiling, once; it takes a minute or two...\n"  # a clock is for terminals
    assert capsys.readouterr() == ("", line)


def test_what_cannot_be_compiled_is_not_noted(started, monkeypatch):
    monkeypatch.setattr(sys, "executable", "/bin/false")
    warm_up.compile_apart(Scenario())
    assert [process.returncode for process in started] == [1, 1] and not jit.is_complete(TRUTH)


def test_races_that_start_at_once_compile_once(started):
    with jit.locked():
        other = threading.Thread(target=warm_up.compile_apart, args=[Scenario()])
        other.start()
        other.join(0.2)
        assert other.is_alive()  # it waits, while this race compiles:
        jit.set_complete(TRUTH)
    other.join()
    assert started == []


def make_tracker(scenario):
    """A box of the tests, which only this process's path leads to."""
    from airrace.systems.planning.trajectory_tracker import TrajectoryTracker

    return TrajectoryTracker()


def children(pid):
    """Returns the processes that a process has started, as Linux tells it."""
    return [int(each) for each in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def runs(pid):
    """Whether a process is there, and has not ended."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.slow
@pytest.mark.parametrize("number", first([signal.SIGTERM, signal.SIGKILL]))
def test_a_race_that_is_killed_while_it_compiles_leaves_nothing(tmp_path, number):
    folders = {name: tmp_path / name for name in ("code", "temporary", "runs")}
    for folder in folders.values():
        folder.mkdir()
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folders["code"])}
    environment["TMPDIR"] = str(folders["temporary"])
    words = ["--track", "hexagon", "--no-meshcat"]
    command = [sys.executable, "-m", "airrace", "race", *words]
    with subprocess.Popen(
        command, env=environment, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as race:
        while len(compilers := children(race.pid)) < 2:
            assert race.poll() is None
            time.sleep(0.05)
        race.send_signal(number)
        assert race.wait(30.0) == (1 if number == signal.SIGTERM else -number)
    deadline = time.monotonic() + 30.0
    while any(map(runs, compilers)):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    left = [*folders["temporary"].iterdir(), *folders["runs"].iterdir()]
    assert len(left) == (0 if number == signal.SIGTERM else 2)
    for folder in left:  # as if it was some time ago
        os.utime(folder, (0.0, 0.0))
    run = folders["runs"] / "20260101T000000Z-next"
    with results_folder(run, numbered=True), mock.patch("tempfile.tempdir", environment["TMPDIR"]):
        with temporary_folder():
            pass
    assert not any(folder.exists() for folder in left)
