"""Whole races: simulated on one host, flown by the autonomy that ssh has started on the other.

Most take minutes of real time and both cores of a small machine, so one after the other:
AIRRACE_LONG_TESTS=1 ./test.bash -n 0 tests/hitl/companion/test_race_over_ssh.py
"""

import contextlib
import json
import os
import subprocess
import sys
import threading
import time
import types
from pathlib import Path

import pytest

from airrace.common.files import digest
from airrace.common.patience import patient
from airrace.common.resources import models_path
from airrace.hitl.channels import make_channels
from airrace.hitl.companion.set_up import LOCK, source_digest
from airrace.hitl.hitl_race import default_url
from airrace.hitl.link.endpoint import HEARTBEAT
from airrace.scenario import Scenario
from tests.hitl.companion.conftest import ADDRESS
from tests.hitl.companion.fake_checkout import ROOT
from tests.hitl.companion.test_lost_connection import programs

long_test = pytest.mark.skipif(
    not os.environ.get("AIRRACE_LONG_TESTS"), reason="takes minutes: set AIRRACE_LONG_TESTS=1"
)
PATIENCE = 600.0  # s
# s into the second lap: there it may go straight on, as it does when it is alone and brakes,
# without meeting a pylon. (When the first begins, depends on how long its plan takes.)
LAPPING = 8.7
EACH = 1500
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(models_path().parent)}


@pytest.fixture
def board(hosts):
    """The hosts; the companion has an environment of the lock: that of these tests.

    What is brought finds the machine code of these tests' own checkout there, as after an earlier
    race; see bring_machine_code.py. Else a board would compile for a minute.
    """
    cache = hosts.home / ".cache/airrace"
    environment = cache / "environments" / digest(ROOT / LOCK)
    (environment / "bin").mkdir(parents=True, exist_ok=True)
    python = environment / "bin" / "python"
    # Not a link, by which it would lose its packages.
    bring = f"{sys.executable} -I {Path(__file__).with_name('bring_machine_code.py')} {ROOT}"
    python.write_text(f'#!/bin/sh\n{bring} "$PYTHONPATH"\nexec {sys.executable} "$@"\n')
    python.chmod(0o755)
    (environment / "complete").touch()
    yield hosts
    assert len(list(cache.glob("environments/*"))) == 1  # that very one was used


def race(output, *options, meanwhile=lambda line, program: None):
    """Flies a race of one lap from the command line; returns its end and race.json.

    Args:
        meanwhile: called with its lines, one after the other, as they come, and its process.
    """
    said = []
    with subprocess.Popen(
        [
            sys.executable,
            "-m",
            "airrace",
            "race",
            "--no-meshcat",
            "--no-report",
            "--laps",
            "1",
            "--output",
            str(output),
            *options,
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**ENVIRONMENT, "HOME": _home()},
    ) as program:
        patience = threading.Timer(patient(PATIENCE), program.kill)
        patience.start()
        try:
            for line in program.stdout:
                said.append(line)
                meanwhile(line, program)
        finally:
            patience.cancel()
            program.terminate()
    file = output / "race.json"
    return types.SimpleNamespace(returncode=program.returncode, said="".join(said)), (
        json.loads(file.read_text()) if file.exists() else None
    )


def _home():
    return os.environ["HOME"]  # the workstation's, which has the key


def check_lockstep(board, track, folder, time_limit):
    """Flies a race here and over the cable, which must be the same to the last bit."""
    limit = f"{{referee: {{time_limit: {time_limit}}}}}"
    options = ["-t", "3", "--track", track, "--scenario_text", limit]
    done, sitl = race(folder / "sitl", *options)
    assert sitl is not None, done.said
    done, result = race(
        folder / "hitl", *options, "-s", "HITL", "--lockstep", "--companion", str(ADDRESS)
    )
    assert done.returncode == (0 if sitl["finished"] else 1), done.said
    for each in (sitl, result):
        del each["wall"]
    assert result == sitl
    # The airrace that flew is the one that was brought.
    (package,) = (board.home / ".cache/airrace/packages").iterdir()
    assert package.name == source_digest(ROOT)
    assert not list((board.home / ".cache/airrace/runs").iterdir())
    logs = list((folder / "hitl").rglob("autonomy.log"))
    assert len(logs) == 1 and "airrace: autonomy ready" in logs[0].read_text()
    return sitl


@pytest.mark.repeats
def test_the_start_of_a_race_in_lockstep(board, hexagon, tmp_path):
    """However busy the machine is.

    That what was not compiled before is compiled first, in both halves of the autonomy, is tested
    in tests/diagrams/test_warm_up.py.
    """
    assert not check_lockstep(board, hexagon, tmp_path, time_limit=2.5)["finished"]
    assert not programs(board, "airrace")


@pytest.mark.repeats
def test_a_race_in_lockstep_that_is_interrupted(board, tmp_path):
    def interrupt(line, program):
        if "TAKE_OFF" in line:
            program.terminate()

    done, result = race(
        tmp_path / "out",
        "-s",
        "HITL",
        "--lockstep",
        "--companion",
        str(ADDRESS),
        meanwhile=interrupt,
    )
    assert done.returncode == 1 and "interrupted" in result["dnf_reason"]
    assert not programs(board, "airrace")


@long_test
def test_a_whole_race_in_lockstep(board, hexagon, tmp_path):
    assert check_lockstep(board, hexagon, tmp_path, time_limit=600.0)["finished"]


@pytest.fixture(scope="module")
def reference_lap(tmp_path_factory):
    """race.json of a lap of the track student-airrace in one process."""
    return race(tmp_path_factory.mktemp("sitl") / "race")[1]


@long_test
@pytest.mark.parametrize(
    "bad", [None, {"delay": 20, "jitter": 5, "loss": 1}], ids=["cable", "bad-cable"]
)
def test_reference_race(board, reference_lap, tmp_path, bad):
    with board.bad_cable(**bad) if bad else contextlib.nullcontext():
        done, result = race(tmp_path / "hitl", "-s", "HITL", "--companion", str(ADDRESS))
    assert done.returncode == 0, done.said[-3000:]
    assert result["finished"]
    if not bad:
        assert result["mean_lap_s"] == pytest.approx(reference_lap["mean_lap_s"], rel=0.03)


@long_test
@pytest.mark.parametrize("pulled", [0.2, 1.0, 5.0])
def test_a_cable_that_is_pulled_in_mid_lap(board, hexagon, tmp_path, pulled):  # noqa: F811
    """For a moment: nothing but a hold. For a second: a hover, and on. For good: down."""

    def meanwhile(line, program):
        if "lap 1:" in line:
            time.sleep(LAPPING)
            board.cable(plugged=False)
            time.sleep(pulled)
            board.cable(plugged=True)

    done, result = race(
        tmp_path / "hitl",
        "-s",
        "HITL",
        "--companion",
        str(ADDRESS),
        "--track",
        hexagon,
        "--laps",
        "3",
        meanwhile=meanwhile,
    )
    assert result["finished"] == (pulled < 2.0), done.said[-3000:]
    assert result["collisions"] == 0 and result["exploration"]["success"]
    watchdog = result["wall"]["link"]["watchdog"]
    assert watchdog["holds"] >= 1
    assert (watchdog["hovers"], watchdog["landings"]) == (int(pulled >= 1.0), int(pulled >= 5.0))
    if pulled >= 5.0:
        assert result["dnf_reason"].endswith("and the drone landed by itself")


@long_test
def test_a_flood_changes_nothing(board, hexagon, tmp_path):  # noqa: F811
    """Of messages that were overtaken long ago, and of torn ones, on all channels."""
    calm = race(tmp_path / "sitl", "--track", hexagon)[1]
    names = [row.name for row in make_channels(Scenario(track=hexagon))]
    flood = subprocess.Popen(
        [
            sys.executable,
            str(Path(__file__).with_name("flood.py")),
            default_url(str(ADDRESS)),
            ",".join(names),
            str(EACH),
            "1000",
        ],
        stdout=subprocess.PIPE,
        text=True,
        env=ENVIRONMENT,
    )
    with flood:
        done, result = race(
            tmp_path / "hitl", "-s", "HITL", "--companion", str(ADDRESS), "--track", hexagon
        )
        flood.kill()
        assert flood.stdout.read() == "heard\nsent\n"
    assert done.returncode == 0, done.said[-3000:]
    assert result["mean_lap_s"] == pytest.approx(calm["mean_lap_s"], rel=0.03)
    for name, channel in result["wall"]["link"]["channels"].items():
        if name != HEARTBEAT:
            counted = channel["dropped"]
            assert counted.pop("replayed or reordered") == pytest.approx(EACH, rel=0.02), name
            assert sum(counted.values()) == pytest.approx(EACH, rel=0.02), name
