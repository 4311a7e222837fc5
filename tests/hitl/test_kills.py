"""A race's simulation, or its autonomy, is killed: what is left, by phase and by signal."""

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from typing import NamedTuple
from unittest import mock

import psutil
import pytest

from airrace.common import held_folders
from airrace.common.patience import patient
from airrace.common.resources import models_path
from airrace.hitl.companion import READY

NETWORK = [
    *("unshare", "-n", "bash", "-c"),
    'ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo && exec "$@"',
    "--",
]
pytestmark = pytest.mark.skipif(
    os.geteuid() != 0
    or subprocess.run(["unshare", "-n", "ip", "link"], capture_output=True, check=False).returncode
    != 0,
    reason="a network of one's own (unshare -n) takes root",
)
SCENARIO = "{camera: {width: 640, height: 360}, referee: {time_limit: 200.0}}"
LOCKSTEP, REAL_TIME = ("--lockstep",), ("--realtime_rate", "0.5")
KILL, TERM, INT, SEGV = signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGSEGV
CONT = signal.SIGCONT  # ends a pause, and nothing else


class Case(NamedTuple):
    phase: str  # words on the terminal, after which it is killed; or as soon as there are both
    options: tuple[str, ...]
    victim: str  # simulation or autonomy
    number: int  # of the signal
    code: int  # with which the race ends
    reason: str | None  # in race.json; None: there is none
    said: str = ""  # on the terminal, or nothing that is looked for
    pause: float = 0.0  # s, for which the victim stands still before


STARTING, READY_TO_RACE = "", READY
EXPLORING, RACING = "TAKE_OFF", "DONE: hovering over the start"
SILENT = r".*the autonomy fell silent at .* \({}\)"
NOTHING_HEARD = "it heard nothing of the simulation for 5 s"
KILLED, SEGFAULT = "its process was killed: SIGKILL", "its process was killed: SIGSEGV"
CASES = [
    Case(STARTING, LOCKSTEP, "simulation", KILL, -9, None),
    Case(STARTING, LOCKSTEP, "simulation", TERM, 1, None, "interrupted"),
    Case(STARTING, LOCKSTEP, "simulation", INT, 1, None, "interrupted"),
    Case(STARTING, LOCKSTEP, "autonomy", KILL, 2, None, "killed: SIGKILL before the race"),
    Case(READY_TO_RACE, REAL_TIME, "simulation", KILL, -9, None),
    Case(EXPLORING, REAL_TIME, "simulation", KILL, -9, "not over yet"),
    Case(EXPLORING, REAL_TIME, "simulation", TERM, 1, "interrupted"),
    Case(EXPLORING, REAL_TIME, "autonomy", SEGV, 1, SILENT.format(SEGFAULT), SEGFAULT),
    Case(EXPLORING, REAL_TIME, "autonomy", TERM, 1, SILENT.format("it was told to stop")),
    Case(EXPLORING, LOCKSTEP, "simulation", KILL, -9, "not over yet"),
    Case(EXPLORING, LOCKSTEP, "simulation", INT, 1, "interrupted"),
    Case(EXPLORING, LOCKSTEP, "autonomy", KILL, 1, rf"the autonomy left the race \({KILLED}\)"),
    Case(EXPLORING, LOCKSTEP, "autonomy", TERM, 1, r"the autonomy left .*\(it was told to stop\)"),
    Case(EXPLORING, REAL_TIME, "simulation", TERM, 1, "interrupted", pause=1.0),
    Case(EXPLORING, REAL_TIME, "autonomy", KILL, 1, SILENT.format(KILLED), pause=1.0),
    Case(EXPLORING, REAL_TIME, "simulation", CONT, 1, SILENT.format(NOTHING_HEARD), pause=12.0),
    Case(RACING, LOCKSTEP, "simulation", KILL, -9, "not over yet"),
    Case(RACING, LOCKSTEP, "simulation", INT, 1, "interrupted"),
    Case(RACING, LOCKSTEP, "autonomy", KILL, 1, rf"the autonomy left the race \({KILLED}\)"),
]
IN_SHORT = (3, 11)  # those that are always tried: it can't start; it dies in the race


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, marks=pytest.mark.slow if i in IN_SHORT else pytest.mark.repeats)
        for i, case in enumerate(CASES)
    ],
    ids=lambda case: "-".join(
        (
            re.sub(r"\W+", "_", case.phase)[:8] or "start",
            case.options[0][2:],
            case.victim,
            str(case.number),
            *(("paused",) if case.pause else ()),
        )
    ),
)
def test_what_a_kill_leaves(case, hexagon, tmp_path):
    temporary, output = tmp_path / "temporary", tmp_path / "out"
    temporary.mkdir()
    command = [
        *(*NETWORK, sys.executable, "-m", "airrace", "race", "--no-meshcat", "--no-report"),
        *("--laps", "1", "--track", hexagon, "--output", str(output), "-t", "3"),
        *("--scenario_text", SCENARIO, "-s", "HITL", *case.options),
    ]
    environment = {
        **os.environ,
        "PYTHONPATH": str(models_path().parent),
        "OMP_NUM_THREADS": "1",
        "TMPDIR": str(temporary),
    }
    race = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment
    )
    mine = psutil.Process(race.pid)
    lines, family = [], []
    try:
        for line in race.stdout if case.phase else ():
            lines.append(line)
            if re.search(case.phase, line):
                break
        autonomy = autonomy_of(mine)
        time.sleep(0.5)
        family = mine.children(recursive=True)
        victim = psutil.Process(race.pid if case.victim == "simulation" else autonomy.pid)
        if case.pause:
            victim.suspend()
            time.sleep(case.pause)
            victim.resume()
            time.sleep(1.0)
        victim.send_signal(case.number)
        lines.append(race.communicate(timeout=patient(120))[0])
        text = "".join(lines)
        assert race.returncode == case.code, text
        # The autonomy sees that the simulation is gone.
        _, alive = psutil.wait_procs(family, timeout=patient(20))
        assert alive == [], text
    finally:
        for process in (race, *family):
            if process in (race,) or process.is_running():
                process.kill()
    assert case.said in text
    check_results(output, case, text)
    check_temporary(temporary, case)


def autonomy_of(race):
    """Returns the process of the autonomy, once the race has started it."""
    end = time.monotonic() + patient(90)
    while time.monotonic() < end and race.is_running():
        for child in race.children():
            with contextlib.suppress(psutil.NoSuchProcess):  # it has just ended
                if "autonomy" in child.cmdline():
                    return child
        time.sleep(0.02)
    raise AssertionError("the race has started no autonomy")


def check_results(output, case, text):
    if case.reason is None:
        left = [path.name for path in output.iterdir()] if output.exists() else []
        assert left in ([], ["autonomy"]), text  # which its navigator leaves when it has compiled
        return
    result = json.loads((output / "race.json").read_text())
    assert re.match(case.reason, result["dnf_reason"]), result["dnf_reason"]
    assert not result["finished"]
    assert json.loads((output / "map.json").read_text())["gates"] is not None
    assert (output / "scenario.yaml").exists()


def check_temporary(temporary, case):
    """Nothing is left, or what the next race removes, since nobody holds it."""
    if case.victim == "simulation" and case.number == KILL:
        with (
            mock.patch("tempfile.tempdir", str(temporary)),
            mock.patch.object(held_folders, "_YOUNG", 0.0),
            held_folders.temporary_folder(),
        ):
            pass
    assert sorted(temporary.iterdir()) == []
