"""What the recorder does to a race: nothing; and what a race leaves when it is killed."""

import json
import signal
import subprocess
import sys
import textwrap

import pytest

from airrace.analysis import load_run
from airrace.analysis.report import write_report
from airrace.diagrams.race import MakeRace, run_race
from airrace.scenario import Scenario, load_scenario, scenario_yaml
from tests.worlds.looks import Looks

TIME_LIMIT = 3.0  # s, in which the drone takes off and flies towards gate 1


def short(content):
    scenario = load_scenario(scenario_text=f"recording: {{content: {content}}}")
    scenario.referee.time_limit = TIME_LIMIT
    return scenario


@pytest.fixture(scope="module")
def races(tmp_path_factory):
    """The same race, recorded in each way: folder, race.json and the states flown."""
    result = {}
    for content in ("none", "light", "full"):
        folder, looks = tmp_path_factory.mktemp(content), Looks()
        data = run_race(short(content), folder, sinks=[looks.take])
        states = [look.state.tolist() for look in looks]
        del data["wall"]
        result[content] = folder, data, states
    return result


@pytest.mark.slow
def test_recording_changes_nothing(races):
    _, data, states = races["none"]
    for content in ("light", "full"):
        assert races[content][1] == data
        assert races[content][2] == states
        for name in ("map.json", "map_statistics.json"):
            assert (races[content][0] / name).read_bytes() == (races["none"][0] / name).read_bytes()


@pytest.mark.slow
def test_none_leaves_no_log(races):
    assert not (races["none"][0] / "race.mcap").exists()


@pytest.mark.slow
def test_a_real_race_has_every_signal(races):
    folder, _, states = races["full"]
    run = load_run(folder)
    assert run.complete
    for name in (
        "state",
        "estimate",
        "filtered",
        "reference",
        "tracking",
        "rotors",
        "detections",
        "map",
        "gates",
        "events",
        "disturbance",
    ):
        assert len(run.tables[name]) > 0, name
    end = run.state.iloc[-1]
    assert end.time == pytest.approx(TIME_LIMIT, abs=0.11)
    at = round(end.time * 10) - 1
    assert [end.x, end.y, end.z] == pytest.approx(states[at][4:7], abs=0.5)
    assert run.map.error.max() < 0.2
    pictures = list(run.images())
    assert 10 <= len(pictures) <= 16 and pictures[0][1].shape == (360, 640)
    assert pictures[0][1].std() > 5  # it shows something
    assert len(list(load_run(races["light"][0]).images())) == 0
    assert "did not finish" in write_report(folder).read_text().lower()


@pytest.mark.slow
def test_the_log_says_what_was_raced(races):
    from mcap.reader import make_reader

    with open(races["light"][0] / "race.mcap", "rb") as file:
        files = {a.name: a.data.decode() for a in make_reader(file).iter_attachments()}
    assert files["scenario.yaml"] == scenario_yaml(short("light"))
    assert "student-airrace" in files["track.yaml"] and "rotors:" in files["vehicle.yaml"]


def test_gates_that_move_are_recorded(tmp_path):
    scenario = Scenario()
    scenario.disturbances.gate_shift = 0.5
    observer = MakeRace(scenario, tmp_path).GetSubsystemByName("race_observer")
    assert observer.HasInputPort("truth.gate_shifts")
    observer.close()


KILLED = """
import sys
from pathlib import Path
from airrace.diagrams.race import run_race
from airrace.scenario import Scenario
run_race(Scenario(), Path(sys.argv[1]), sinks=[lambda event: print(event.time, flush=True)])
"""


@pytest.mark.slow
def test_a_race_that_is_killed_can_be_read_to_the_last_second(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(KILLED), str(tmp_path)],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        for line in process.stdout:
            if float(line) > 4.75:
                break
        process.kill()
        # What it did between that and its end.
        times = [float(line), *map(float, process.stdout.read().split())]
    finally:
        process.kill()
        process.stdout.close()
        assert process.wait() == -signal.SIGKILL
    run = load_run(tmp_path)
    assert not run.complete and run.result["dnf_reason"] == "not over yet"
    assert run.state.time.max() > max(times) - 1.0
    assert run.detections.time.max() > max(times) - 1.0
    assert [e for e in run.events.name if e in ("CALIBRATE", "TAKE_OFF")] == [
        "CALIBRATE",
        "TAKE_OFF",
    ]
    assert json.loads((tmp_path / "map.json").read_text())["time_s"] > max(times) - 1.2
    assert "The recording ends at" in write_report(tmp_path).read_text()
