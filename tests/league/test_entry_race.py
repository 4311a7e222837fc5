"""Races of entries in the sandbox: equal to those without one, and nothing to be had by cheating."""

import dataclasses as dc
import json
import runpy
import textwrap

import pytest

from airrace.commands.app import main
from airrace.diagrams.race import run_race
from airrace.evaluation.versions import versions
from airrace.league import check
from airrace.league.entry import load_entry
from airrace.league.sandbox import SandboxConfig, why_no_sandbox
from airrace.league.scenarios import race_scenario
from airrace.league.season import Limits, Season, make_legs
from airrace.league.worker import fly, make_flight
from tests.league.entries import make_entry
from tests.league.seasons import result

# Long enough to take off and to see the first gate.
SEASON = Season(
    name="short",
    levels=[1],
    tracks=1,
    track="hexagon",
    seed_file="s",
    scenario_text="{referee: {time_limit: 4.0}, camera: {width: 320, height: 180}}",
    replays=False,
)
LEG = make_legs(SEASON, "nobody can guess this")[0]
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        why_no_sandbox() is not None, reason=f"there is no sandbox: {why_no_sandbox()}"
    ),
]


def flown(folder, **limits):
    """The row of an entry's race in the sandbox."""
    sandbox = SandboxConfig(safe=True, replay=False, limits=Limits(**limits))
    return fly(make_flight(SEASON, LEG, load_entry(folder), sandbox, versions({})), "tests")


# It tries all, writes what came of it, and ends: nothing of it needs a race.
CHEAT = textwrap.dedent(
    """
    import ctypes, json, mmap, os, pathlib, socket, subprocess, sys, threading
    import airrace

    def tried(do):
        try:
            return repr(do())[:80]
        except BaseException as e:
            return type(e).__name__

    def fill(place):
        with open(place + "/big", "wb") as file:
            for _ in range(90):
                file.write(bytes(1 << 20))

    def fork():
        if os.fork() == 0:
            os._exit(0)
        return "forked"

    def raw_fork():
        libc = ctypes.CDLL(None, use_errno=True)
        child = libc.syscall(57 if os.uname().machine == "x86_64" else -1)
        if child == 0:
            os._exit(0)
        return "no" if child < 0 else "forked"

    def erase_log():
        os.ftruncate(1, 0)
        return "erased"

    def reopen_log():
        with open("/proc/self/fd/1", "r+b") as log:
            log.truncate(0)
        return "erased"

    libc = ctypes.CDLL(None, use_errno=True)
    models = pathlib.Path(airrace.__file__).parents[1] / "models"
    above = pathlib.Path("/race").resolve().parent
    ATTEMPTS = {
        "track": lambda: (models / "tracks" / "hexagon.yaml").read_text(),
        "tracks": lambda: os.listdir(models / "tracks") or 1 / 0,
        "entries": lambda: os.listdir(models / "entries") or 1 / 0,
        "home": lambda: open("/root/.profile"),
        "race": lambda: (above / "track.yaml").read_text(),
        "temporary": lambda: [n for n in os.listdir("/tmp") if n.startswith("airrace-")] or 1 / 0,
        "processes": lambda: [n for n in os.listdir("/proc") if n.isdigit() and n != "1"] or 1 / 0,
        "parent": lambda: open(f"/proc/{os.getppid()}/environ").read(),
        "environment": lambda: os.environ["AIRRACE_SECRET"],
        "network": lambda: socket.socket().connect(("127.0.0.1", 8786)),
        "unix": lambda: socket.socket(socket.AF_UNIX).connect("/run/x"),
        "process": lambda: subprocess.run(["/bin/true"], check=True),
        "fork": fork,
        "raw_fork": lambda: raw_fork() == "forked" or 1 / 0,
        "write_airrace": lambda: open(airrace.__file__, "a"),
        "write_entry": lambda: open(__file__, "a"),
        "write_root": lambda: open("/mine", "w"),
        "write_results": lambda: open("/race/race.json", "w"),
        "fill_tmp": lambda: fill("/tmp"),
        "fill_shm": lambda: fill("/dev/shm"),
        "memory": lambda: bytearray(8 << 30),
        "memfd": lambda: os.memfd_create("mine"),
        "segment": lambda: libc.shmget(0, 1 << 30, 0o1600) >= 0 or 1 / 0,
        "open_files": lambda: [open("/dev/null") for _ in range(500)],
        "erase_log": erase_log,
        "reopen_log": reopen_log,
        "kill": lambda: os.kill(os.getppid() or 1 / 0, 9),
    }
    ALLOWED = {
        "thread": lambda: threading.Thread(target=len, args=("",)).start(),
        "own": lambda: open("/tmp/mine", "w").close(),
        "read_airrace": lambda: open(airrace.__file__).close(),
        "models": lambda: (models / "default" / "vehicle.yaml").read_text() and None,
    }

    def make(scenario):
        for name, do in {**ATTEMPTS, **ALLOWED}.items():
            print("came of it:", json.dumps([name, tried(do)]), flush=True)
        __import__("airrace.diagrams.simulation")
        raise ValueError("that was all")
    """
)


@pytest.fixture(scope="module")
def cheat(tmp_path_factory):
    """The row of an entry that tries all."""
    folder = tmp_path_factory.mktemp("entries") / "cheat"
    text = "team: Cuckoos\nsystems: {explorer: 'mine:make'}\n"
    return flown(make_entry(folder, text, mine=CHEAT), disk=0.06)  # with the machine code


def test_each_attempt_at_cheating_fails(cheat):
    log = cheat["files"]["entry.log"].decode()
    found = dict(json.loads(line[12:]) for line in log.splitlines() if line[:11] == "came of it:")
    ok = {name: found.pop(name) for name in ("thread", "own", "read_airrace", "models")}
    assert set(ok.values()) == {"None"}, ok
    errors = {
        "PermissionError",
        "FileNotFoundError",
        "ZeroDivisionError",
        "OSError",
        "MemoryError",
        "KeyError",
        "UnsupportedOperation",  # a pipe cannot be rewound
    }
    assert {name: end for name, end in found.items() if end not in errors} == {}
    assert len(found) == 27


def test_each_attempt_is_named(cheat):
    attempts = " | ".join(cheat["conduct"]["attempts"])
    for words in (
        "models/tracks/hexagon.yaml",
        "read /root/.profile",
        "read /track.yaml",
        "/proc/0/environ",
        "opened a socket",
        "started a process (subprocess.Popen)",
        "started a process (os.fork)",
        "wrote to /mine",
        "wrote to /race/race.json",
        "wrote to /race/entry/mine.py",
        "imported airrace.diagrams.simulation",
    ):
        assert words in attempts, attempts
    assert "models/default" not in attempts


def test_the_race_says_why_it_was_not_flown(cheat):
    assert not cheat["result"]["finished"]
    assert "ValueError: that was all, at /race/entry/mine.py" in cheat["result"]["dnf_reason"]


@pytest.fixture(scope="module")
def optimal():
    """The row of a shipped entry."""
    return flown("optimal")


def test_the_wall_changes_no_bit(optimal, tmp_path):
    """The race behind it is that of airrace race."""
    entry, row = load_entry("optimal"), optimal
    assert "ran out of time" in row["result"]["dnf_reason"]
    scenario = race_scenario(SEASON, LEG, entry)
    track = tmp_path / "track.yaml"
    track.write_text(LEG.track)
    (tmp_path / "out").mkdir()
    run_race(dc.replace(scenario, track=str(track)), tmp_path / "out")
    expected = json.loads((tmp_path / "out" / "race.json").read_text())
    expected.pop("wall")
    assert row["result"] == expected
    assert row["conduct"]["steps"] > 4000 and row["conduct"]["attempts"] == []


@pytest.mark.repeats
def test_a_new_entry_flies_as_the_shipped_systems_do(optimal, tmp_path, monkeypatch):
    """All six of its systems; so a team that changes one sees what that does."""
    monkeypatch.chdir(tmp_path)
    assert main(["new", "entry", "herons"]) == 0
    result = flown(tmp_path / "herons")["result"]
    assert len(result.pop("systems")) == 6
    assert result == optimal["result"]
    assert len(load_entry("herons").config.systems) == 6


def test_the_lap_that_a_new_entry_tests(optimal, tmp_path, monkeypatch, capsys):
    """With the short race of above in the place of its lap: does the file tell one from the other?"""
    monkeypatch.chdir(tmp_path)
    assert main(["new", "entry", "herons"]) == 0
    unfinished, finished = optimal, {**optimal, "result": result((9.44,))}
    monkeypatch.setattr(check, "fly_check", lambda entry, safe: finished)
    runpy.run_path("herons/test_lap.py", run_name="__main__")
    assert "finished, mean lap 9.440 s" in capsys.readouterr().out
    monkeypatch.setattr(check, "fly_check", lambda entry, safe: unfinished)
    with pytest.raises(AssertionError):
        runpy.run_path("herons/test_lap.py", run_name="__main__")
    assert "did not finish: ran out of time" in capsys.readouterr().out


LOOP = "def make(scenario):\n    while True:\n        pass\n"


@pytest.mark.repeats
def test_an_endless_loop_before_the_race(tmp_path):
    text = "team: A\nsystems: {explorer: 'mine:make'}\n"
    row = flown(make_entry(tmp_path / "loop", text, mine=LOOP), start_wall=3.0)
    assert row["result"]["dnf_reason"] == "the entry was not ready to race within 3 s"


BUSY = """
from airrace.systems.control.geometric_controller import GeometricController
from airrace.vehicle import load_vehicle

class Busy(GeometricController):
    def calc_wrench(self, reference, estimate):
        while estimate[0] > 0.1:
            pass
        return super().calc_wrench(reference, estimate)

def make(scenario):
    return Busy(vehicle=load_vehicle(scenario.drone)[0], **vars(scenario.controller))
"""


def test_an_endless_loop_in_the_race(tmp_path):
    """Its own time is counted, not that of the others."""
    text = "team: A\nsystems: {geometric_controller: 'mine:make'}\n"
    row = flown(make_entry(tmp_path / "busy", text, mine=BUSY), step_cpu_end=2.0)
    assert row["result"]["dnf_reason"] == "the entry computed 2 s for one step, and did not end"
