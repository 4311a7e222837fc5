"""Evaluations as their users run them; the races are of a fifth of a second, on a given map."""

import contextlib
import io
import json
import os
import re
import signal
import subprocess
import sys

import psutil
import pytest

from airrace.commands.app import main as command
from airrace.common.errors import UserError
from airrace.common.resources import models_path
from airrace.evaluation import cluster
from airrace.evaluation import command as module
from airrace.evaluation.command import EPILOG, check_options
from tests.worlds.command_line import parse
from tests.worlds.processes import descendant, wait_until


def main(words):
    """Calls `airrace evaluate`; returns its exit code."""
    return command(["evaluate", *words])


BRIEFLY = "{referee: {time_limit: 0.2}, map: track, camera: {renderer: none}}"
SHORT = ["--scenario_file", "races", "--scenario_text", BRIEFLY]
RACES = [*SHORT, "--tracks", "2", "--laps", "1"]
REPORT = ("evaluation.json", "evaluation.md", "evaluation.png", "evaluation.html")
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(models_path().parent)}

BAD = [
    (["--tracks", "0"], "--tracks must be at least 1, not 0"),
    (["--track_seed", "-1"], "--track_seed must be at least 0, not -1"),
    (["--workers", "0"], "--workers must be at least 1, not 0"),
    (["--laps", "0"], "laps must be at least 1, not 0"),
    (["--resume"], "--resume needs --output"),
    (["--level", "1"], "leave out --scenario_file"),
    (["-d", "Nimbus"], "no drone named 'Nimbus'"),
    (["--track", "none"], "no track named 'none'"),
    (["--track", "student-airrace", "--scheduler", "here"], "must be tcp://HOST:PORT, not 'here'"),
    (
        ["--track", "student-airrace", "--scheduler", "tcp://127.0.0.1:1"],
        "tcp://127.0.0.1:1 cannot be reached .*'dask scheduler'",
    ),
    (["--track", "student-airrace", "--output", "file"], "--output file cannot be written to"),
    (["--track", "student-airrace", "--output", "full"], "full already holds an evaluation"),
    (
        ["--track", "student-airrace", "--output", "race"],
        r"race already holds results \(race.json\)",
    ),
    (
        ["--track", "student-airrace", "--output", "full", "--resume"],
        "full/evaluation.json is no file with the settings",
    ),
]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    (tmp_path / "race").mkdir()
    (tmp_path / "race" / "race.json").write_text("{}")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "evaluation.json").write_text("{}")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def start(*args, module=("airrace", "evaluate"), env=ENVIRONMENT, **kwargs):
    """Starts a program as a group of processes of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", *module, *map(str, args)],
        env=env,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        **kwargs,
    )


def finish(process, code=0):
    """Waits for a program, which must end with a code; returns what it printed."""
    out, err = process.communicate(timeout=600)  # long, for a busy machine
    assert process.returncode == code, err
    return out, err


def racing(process):
    """Returns the first process that flies a race among the descendants of one."""
    return descendant(process, "airrace.evaluation.race_process")


def gone(processes):
    return not any(p.is_running() and p.status() != psutil.STATUS_ZOMBIE for p in processes)


def reports(folder):
    return {name: (folder / name).read_bytes() for name in REPORT}


def stored_seeds(folder):
    if not (folder / "races.jsonl").exists():
        return []
    lines = (folder / "races.jsonl").read_text().splitlines()
    return sorted(json.loads(line)["seed"] for line in lines)


def check_same(folder, reference):
    assert stored_seeds(folder) == [1000, 1001]
    assert reports(folder) == reports(reference)


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """The folder of an evaluation that nothing disturbed, by one worker."""
    folder = tmp_path_factory.mktemp("reference")
    out, err = finish(start(*RACES, "--workers", 1, "--output", folder))
    assert "Finished 0 of 2 races: 0.0 %, 95 % interval 0.0 to 65.8 %" in out
    assert out.splitlines()[-1] == f"Results: {folder}"
    assert [line for line in err.splitlines() if line.startswith("[2/2] seed 100")]
    return folder


@pytest.fixture(scope="module")
def interrupted(tmp_path_factory):
    """The folder of one after Ctrl-C, and after it went on; and what it said at Ctrl-C."""
    folder = tmp_path_factory.mktemp("interrupted")
    process = start(*RACES, "--workers", 1, "--output", folder)
    wait_until(lambda: stored_seeds(folder) and racing(process))
    family = psutil.Process(process.pid).children(recursive=True)
    os.killpg(process.pid, signal.SIGINT)  # as the terminal does
    _, said = finish(process, 1)
    wait_until(lambda: gone(family), 10)
    flown = (folder / "races.jsonl").read_text()
    assert not json.loads((folder / "evaluation.json").read_text())["complete"]
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        assert main([*RACES, "--workers", "1", "--output", str(folder), "--resume"]) == 0
    out = printed.getvalue()
    assert "Finished 0 of 2 races: 0.0 %, 95 % interval 0.0 to 65.8 %" in out
    assert out.splitlines()[-1] == f"Results: {folder}"
    assert (folder / "races.jsonl").read_text().startswith(flown)
    return folder, said


class TestBadInput:
    @pytest.mark.parametrize("args, words", BAD, ids=[" ".join(a)[-40:] for a, _ in BAD])
    def test_one_sentence_and_nothing_left(self, folder, monkeypatch, capsys, args, words):
        monkeypatch.setattr(cluster, "_CONNECT_TIMEOUT", 0.5)
        monkeypatch.setattr(cluster, "fly_races", lambda *args: pytest.fail("flies"))
        before = sorted(folder.rglob("*"))
        assert main([*SHORT, *args]) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert err.startswith("airrace: ") and err.count("\n") == 1, err
        assert re.search(words, err), err
        assert sorted(folder.rglob("*")) == before

    def test_workers_or_a_scheduler(self, folder, capsys):
        assert main(["--workers", "2", "--scheduler", "tcp://127.0.0.1:1"]) == 2
        assert "exclude each other" in capsys.readouterr().err


class TestOptions:
    def test_help_fits_and_teaches(self, capsys, monkeypatch):
        monkeypatch.setenv("COLUMNS", "80")
        assert main(["--help"]) == 0
        text = capsys.readouterr().out
        for word in ("--resume", "--level", "dask worker", "evaluation.png", "Exit codes: 0"):
            assert word in text
        assert max(map(len, text.splitlines())) <= 88

    def test_the_examples_are_good_and_others_are_not(self):
        with pytest.raises(UserError, match="--scenario_name needs --scenario_file"):
            check_options(parse("evaluate", ["--scenario_name", "Wind"]))
        examples = re.findall(r"^  airrace evaluate(.*)$", EPILOG, re.M)
        assert len(examples) >= 4
        for example in examples:
            check_options(parse("evaluate", example.split()))

    def test_level_1_is_the_default(self, monkeypatch):
        asked = {}

        def load_scenario(**kwargs):
            asked.update(kwargs)
            raise InterruptedError

        monkeypatch.setattr("airrace.scenario.load_scenario", load_scenario)
        for args, name in (([], "Level1"), (["--level", "3"], "Level3")):
            with pytest.raises(InterruptedError):
                module.resolve(parse("evaluate", args))
            assert (asked["filename"], asked["scenario_name"]) == ("levels", name)

    def test_one_track_with_many_seeds(self):
        args = parse(
            "evaluate", [*SHORT, "--track", "student-airrace", "--tracks", "2", "--track_seed", "5"]
        )
        jobs, settings = module.resolve(args)
        assert [job.seed for job in jobs] == [5, 6] and jobs[0].track == jobs[1].track
        assert "seed: 6" in jobs[1].scenario
        assert settings["track"] == "the track student-airrace"


@pytest.mark.slow
def test_the_results(interrupted):
    folder, _ = interrupted
    data = json.loads((folder / "evaluation.json").read_text())
    assert data["complete"] and data["summary"]["dnf_reasons"] == {
        "ran out of time in state CALIBRATE": 2
    }
    assert [race["seed"] for race in data["races"]] == [1000, 1001]
    assert len({race["length_m"] for race in data["races"]}) == 2
    assert data["settings"]["scenario"]["laps"] == 1
    text = (folder / "evaluation.md").read_text()
    assert text.startswith("# Default, optimal, races Defaults: 2 races of 1 lap, generated tracks")


@pytest.mark.repeats
def test_a_killed_race_is_flown_again(reference, tmp_path):
    process = start(*RACES, "--workers", 2, "--output", tmp_path)
    wait_until(lambda: racing(process)).kill()
    finish(process)
    check_same(tmp_path, reference)


@pytest.mark.slow
def test_ctrl_c(interrupted, capsys):
    """It leaves no process behind, and what was flown is not flown again."""
    folder, said = interrupted
    assert re.fullmatch(
        r"airrace: interrupted; 1 of 2 races are in .*--resume flies the others\.",
        said.splitlines()[-1],
    ), said
    assert "Traceback" not in said
    # Nothing is left to fly.
    assert main([*RACES, "--output", str(folder), "--resume"]) == 0
    out, err = capsys.readouterr()
    assert "Finished 0 of 2" in out and err == ""


@pytest.mark.repeats
def test_after_ctrl_c_its_results_are_those_of_one_that_nothing_disturbed(interrupted, reference):
    check_same(interrupted[0], reference)


@pytest.mark.repeats
def test_a_crash(tmp_path):
    process = start(*RACES, "--workers", 1, "--output", tmp_path)
    wait_until(lambda: stored_seeds(tmp_path) and racing(process))
    family = psutil.Process(process.pid).children(recursive=True)
    process.kill()
    process.communicate()
    wait_until(lambda: gone(family), 20)
    flown = (tmp_path / "races.jsonl").read_text()
    finish(start(*RACES, "--workers", 1, "--output", tmp_path, "--resume"))
    assert (tmp_path / "races.jsonl").read_text().startswith(flown)
    assert stored_seeds(tmp_path) == [1000, 1001]


@contextlib.contextmanager
def running(module_, *args, **kwargs):
    """A program of Dask's, killed at the end of the block."""
    process = start(*args, module=(module_,), stdin=subprocess.DEVNULL, **kwargs)
    try:
        yield process
    finally:
        family = [psutil.Process(process.pid), *psutil.Process(process.pid).children(True)]
        for one in family:
            with contextlib.suppress(psutil.Error):
                one.kill()
        process.communicate()


@contextlib.contextmanager
def dask_by_hand(folder, workers=2):
    """Starts a scheduler and workers on loopback; yields its address and process."""
    folder.mkdir()
    file = folder / "scheduler.json"
    with contextlib.ExitStack() as stack:
        scheduler = stack.enter_context(
            running(
                "distributed.cli.dask_scheduler",
                "--host",
                "127.0.0.1",
                "--port",
                "0",
                "--no-dashboard",
                "--dashboard-address",
                "127.0.0.1:0",
                "--scheduler-file",
                file,
                # It needs no airrace.
                cwd=folder,
                env={k: v for k, v in ENVIRONMENT.items() if k != "PYTHONPATH"},
            )
        )
        wait_until(file.exists)
        address = wait_until(lambda: json.loads(file.read_text() or "{}").get("address"))
        for _ in range(workers):
            stack.enter_context(
                running(
                    "distributed.cli.dask_worker",
                    address,
                    "--nthreads",
                    "1",
                    "--no-dashboard",
                    "--host",
                    "127.0.0.1",
                    "--local-directory",
                    folder,
                    # Killed together with its race, it leaves the race's files behind.
                    env={**ENVIRONMENT, "TMPDIR": str(folder)},
                )
            )
        yield address, scheduler


@pytest.mark.repeats
def test_a_dask_cluster_started_by_hand(reference, tmp_path):
    """And its scheduler is killed in the middle."""
    output = tmp_path / "out"
    with dask_by_hand(tmp_path / "first", workers=1) as (address, scheduler):
        process = start(*RACES, "--scheduler", address, "--output", output)
        wait_until(lambda: stored_seeds(output))
        scheduler.kill()
        _, err = finish(process, 1)
        assert "airrace: the scheduler was lost; " in err and "--resume" in err
    assert len(stored_seeds(output)) == 1
    with dask_by_hand(tmp_path / "second") as (address, _):
        finish(start(*RACES, "--scheduler", address, "--output", output, "--resume"))
    check_same(output, reference)


@pytest.mark.slow
def test_workers_that_differ_do_not_fly(folder, monkeypatch, capsys):
    monkeypatch.setattr("airrace.evaluation.jobs.versions", lambda systems: {"airrace": "another"})
    assert (
        main(
            [
                *SHORT,
                "--track",
                "student-airrace",
                "--tracks",
                "1",
                "--workers",
                "1",
                "--output",
                "out",
            ]
        )
        == 2
    )
    err = capsys.readouterr().err.splitlines()[-1]
    assert re.search(r"The worker inproc://.* has airrace .* instead of another;", err)
    assert not (folder / "out").exists()


@pytest.mark.slow
def test_a_race_that_is_refused_ends_the_evaluation(folder, capsys):
    text = "{referee: {time_limit: 0.2}, systems: {explorer: 'nobody:Box'}}"
    assert (
        main(
            [
                "--scenario_file",
                "races",
                "--scenario_text",
                text,
                "--track",
                "student-airrace",
                "--tracks",
                "2",
                "--workers",
                "1",
                "--output",
                "out",
            ]
        )
        == 2
    )
    err = capsys.readouterr().err.splitlines()[-1]
    assert err.startswith("airrace: The race with seed 100") and "No module named 'nobody'" in err
    assert not (folder / "out").exists()
