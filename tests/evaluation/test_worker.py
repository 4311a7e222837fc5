import dataclasses as dc
import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from airrace.commands.app import main as airrace
from airrace.common.resources import models_path
from airrace.evaluation import worker
from airrace.evaluation.jobs import given_track, make_jobs, settings
from airrace.evaluation.worker import RaceKilled, fly, stop_races
from airrace.scenario import load_scenario
from tests.worlds.cases import first


def job(text="referee: {time_limit: 0.2}", seed=3, drone=None):
    scenario = load_scenario(scenario_text=text)
    if drone is not None:
        scenario.drone = drone
    return make_jobs(scenario, [seed], [given_track("student-airrace")])[0]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working directory, and where the races put their files."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tmp").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "tmp"))
    yield tmp_path
    assert list((tmp_path / "tmp").iterdir()) == []


def wait_until(condition):
    deadline = time.monotonic() + 30
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


class TestFly:
    @pytest.mark.slow
    def test_as_if_flown_alone(self, folder):
        """Also with a drone from another machine."""
        (folder / "mine").mkdir()
        for path in (models_path() / "default").iterdir():
            if path.is_file():
                text = path.read_text().replace("name: Default", "name: Mine")
                (folder / "mine" / path.name).write_text(text)
        text = "{referee: {time_limit: 0.2}, laps: 2}"
        there = job(text, drone="mine")
        options = ["--seed", "3", "--scenario_text", text, "--no-meshcat", "--no-report"]
        assert airrace(["race", "-d", "mine", *options, "--output", "alone"]) == 1
        for path in (folder / "mine").iterdir():
            path.unlink()
        row = fly(there, "e")
        alone = json.loads((folder / "alone" / "race.json").read_text())
        del alone["wall"]
        assert row["result"] == alone and alone["drone"] == "Mine"
        assert row["stderr"] is None and row["wall"]["seconds"] > 0.0
        assert (row["seed"], row["gates"], round(row["length_m"])) == (3, 10, 382)

    def test_crashes_cost_one_race_and_leave_their_reason(self, folder):
        (folder / "my_boxes.py").write_text(
            "import os, signal\ndef crash(scenario):\n    os.kill(os.getpid(), signal.SIGSEGV)\n"
        )
        row = fly(job("systems: {explorer: my_boxes:crash}"), "e")
        assert row["result"]["dnf_reason"] == "crashed (SIGSEGV)"
        assert not row["result"]["finished"] and row["wall"] is None

    @pytest.mark.slow
    def test_errors_of_a_box(self, folder):
        (folder / "my_boxes.py").write_text(
            "from airrace.systems.planning.trajectory_tracker import TrajectoryTracker\n"
            "class Tracker(TrajectoryTracker):\n"
            "    def __init__(self, scenario):\n"
            "        super().__init__()\n"
            "    def _calc_reference(self, context, output):\n"
            "        raise ValueError('a mistake')\n"
        )
        row = fly(job("systems: {trajectory_tracker: my_boxes:Tracker}"), "e")
        assert row["result"]["dnf_reason"].startswith("stopped by an error: ")
        assert "a mistake" in row["result"]["dnf_reason"]
        assert "my_boxes.py" in row["stderr"]

    @pytest.mark.repeats
    def test_what_cannot_be_flown_is_refused(self, folder):
        row = fly(job("systems: {explorer: nobody:Box}"), "e")
        assert set(row) == {"seed", "refused"} and "No module named 'nobody'" in row["refused"]

    def test_other_versions_do_not_fly(self, monkeypatch):
        monkeypatch.setattr(worker, "run_process", lambda *args: pytest.fail("flies"))
        other = job()
        other = dc.replace(other, versions={**other.versions, "drake": "1.57.0"})
        assert "instead of 1.57.0" in fly(other, "e")["refused"]

    @pytest.mark.slow
    @pytest.mark.parametrize("signal_name", first(["SIGTERM", "SIGKILL"]))
    def test_killed_races_are_to_be_flown_again(self, folder, signal_name):
        threading.Thread(target=kill_the_race, args=(signal_name,)).start()
        with pytest.raises(RaceKilled, match=signal_name):
            fly(job("referee: {time_limit: 60.0}"), signal_name)

    def test_stopped(self, folder):
        """What flies ends, and nothing more begins."""
        threading.Thread(
            target=lambda: (wait_until(lambda: worker._running["stop"]), stop_races("stop"))
        ).start()
        for _ in range(2):
            with pytest.raises(RaceKilled):
                fly(job("referee: {time_limit: 60.0}"), "stop")


def kill_the_race(name):
    import signal

    wait_until(lambda: worker._running[name])
    (process,) = worker._running[name]
    if name == "SIGTERM":  # of which a race in the air makes the best
        wait_until(lambda: list(Path("tmp").glob("*/results/map.json")))
    process.send_signal(getattr(signal, name))


@pytest.mark.slow
def test_a_race_dies_with_who_waits_for_it(tmp_path):
    folder = tmp_path / "race"
    folder.mkdir()
    given = job("referee: {time_limit: 600.0}")
    (folder / "track.yaml").write_text(given.track)
    (folder / "scenario.yaml").write_text(given.scenario)
    process = subprocess.Popen(
        [sys.executable, "-m", "airrace.evaluation.race_process", folder],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(models_path().parent)},
    )
    try:
        wait_until(lambda: (folder / "results" / "map.json").exists())  # it flies
        assert process.poll() is None
        process.stdin.close()
        process.wait(timeout=10)
    finally:
        process.kill()
    assert not folder.exists()


WRITES_WITHOUT_PAUSE = """
import itertools, sys
from pathlib import Path
from airrace.diagrams import race_command as command
from airrace.evaluation import race_process

def writes(options):
    results = options.output
    for number in itertools.count():
        results.mkdir(exist_ok=True)
        (results / str(number % 500)).write_text("")

command.race = writes
race_process.main(Path(sys.argv[1]))
"""


def test_a_race_that_writes_leaves_nothing_behind(tmp_path):
    folder = tmp_path / "race"
    folder.mkdir()
    command = [sys.executable, "-c", WRITES_WITHOUT_PAUSE, folder]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        try:
            wait_until(lambda: (folder / "results" / "300").exists())
            process.stdin.close()
            process.wait(timeout=10)
        finally:
            process.kill()
    assert not folder.exists()


def test_settings_know_track_scenario_and_drone(tmp_path, monkeypatch):
    def digest(**kwargs):
        return settings([job(**kwargs)], track="t", scenario_name="s")["races_sha256"]

    first = digest()
    assert digest() == first
    assert digest(text="referee: {time_limit: 0.3}") != first
    assert digest(seed=4) != first
    monkeypatch.chdir(tmp_path)
    Path("mine").mkdir()
    for path in (models_path() / "default").iterdir():
        if path.is_file():
            (tmp_path / "mine" / path.name).write_bytes(path.read_bytes())
    mine = digest(drone="mine")
    with open("mine/vehicle.yaml", "a") as file:
        file.write("# heavier\n")
    assert digest(drone="mine") != mine
