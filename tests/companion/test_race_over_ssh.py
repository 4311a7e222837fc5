"""Whole races: simulated on one host, flown by the autonomy that ssh has started on the other.

The reference track takes minutes of real time and both cores of a small machine:
AIRRACE_LONG_TESTS=1 ./test.bash tests/companion/test_race_over_ssh.py
"""

import contextlib
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from airrace.companion.wheel import digest, source_digest
from airrace.resources import models_path
from tests.companion.conftest import ADDRESS
from tests.companion.fake_checkout import ROOT
from tests.diagrams.conftest import hexagon  # noqa: F401  # a fixture

long_test = pytest.mark.skipif(
    not os.environ.get("AIRRACE_LONG_TESTS"), reason="takes minutes: set AIRRACE_LONG_TESTS=1")
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(models_path().parent)}


@pytest.fixture
def board(hosts):
    """The hosts; the companion has an environment of the lock: that of these tests."""
    cache = hosts.home / ".cache/airrace"
    environment = cache / "environments" / digest(ROOT / "requirements.lock")
    (environment / "bin").mkdir(parents=True, exist_ok=True)
    python = environment / "bin" / "python"
    # Not a link, by which it would lose its packages.
    python.write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    python.chmod(0o755)
    (environment / "complete").touch()
    yield hosts
    assert len(list(cache.glob("environments/*"))) == 1  # that very one was used


def race(output, *options, timeout=600):
    """Flies a race of one lap from the command line; returns its end and race.json."""
    done = subprocess.run(
        [sys.executable, "-m", "airrace.diagrams.race", "--no-meshcat", "--laps", "1",
         "--output", str(output), *options],
        capture_output=True, text=True, timeout=timeout, env={**ENVIRONMENT, "HOME": _home()})
    file = output / "race.json"
    return done, json.loads(file.read_text()) if file.exists() else None


def _home():
    return os.environ["HOME"]  # the workstation's, which has the key


@pytest.mark.parametrize("time_limit", [
    5.0, pytest.param(600.0, marks=long_test),
], ids=["start", "whole"])
def test_race_in_lockstep(board, hexagon, tmp_path, time_limit):  # noqa: F811
    """As SITL to the last bit, however busy the machine is."""
    options = ["-t", "3", "--track", hexagon,
               "--scenario_text", f"{{referee: {{time_limit: {time_limit}}}}}"]
    done, sitl = race(tmp_path / "sitl", *options)
    assert sitl is not None, done.stderr
    done, result = race(tmp_path / "hitl", *options, "-s", "HITL", "--lockstep",
                        "--companion", str(ADDRESS))
    assert sitl["finished"] == (time_limit > 5.0)
    assert done.returncode == (0 if sitl["finished"] else 1), done.stdout + done.stderr
    for each in (sitl, result):
        del each["wall"]
    assert result == sitl
    # The airrace that flew is the one that was brought.
    (package,) = (board.home / ".cache/airrace/packages").iterdir()
    assert package.name == source_digest(ROOT)
    assert not list((board.home / ".cache/airrace/runs").iterdir())
    logs = [path for path in Path(tmp_path / "hitl").rglob("autonomy.log")]
    assert len(logs) == 1 and "airrace: autonomy ready" in logs[0].read_text()


def test_interrupted_race_leaves_nothing_running(board, tmp_path):
    with subprocess.Popen(
        [sys.executable, "-m", "airrace.diagrams.race", "--no-meshcat", "-s", "HITL", "--lockstep",
         "--companion", str(ADDRESS), "--output", str(tmp_path / "out")],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        env={**ENVIRONMENT, "HOME": _home()},
    ) as program:
        said = []
        for line in program.stdout:
            said.append(line)
            if "TAKE_OFF" in line:
                break
        else:
            pytest.fail("".join(said))
        program.terminate()
        program.stdout.read()
        assert program.wait(60) == 1
    assert "interrupted" in json.loads((tmp_path / "out/race.json").read_text())["dnf_reason"]
    listed = subprocess.run(["ip", "netns", "pids", board.companion], capture_output=True,
                            text=True).stdout.split()
    assert not [pid for pid in listed
                if b"airrace" in Path(f"/proc/{pid}/cmdline").read_bytes()]


@pytest.fixture(scope="module")
def reference_lap(tmp_path_factory):
    """race.json of a lap of the reference track in one process."""
    return race(tmp_path_factory.mktemp("sitl") / "race")[1]


@long_test
@pytest.mark.parametrize("bad", [
    None, {"delay": 20, "jitter": 5, "loss": 1},
], ids=["cable", "bad-cable"])
def test_reference_race(board, reference_lap, tmp_path, bad):
    with board.bad_cable(**bad) if bad else contextlib.nullcontext():
        done, result = race(tmp_path / "hitl", "-s", "HITL", "--companion", str(ADDRESS))
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    assert result["finished"]
    if not bad:
        assert result["mean_lap_s"] == pytest.approx(reference_lap["mean_lap_s"], rel=0.03)
