"""A season as a teacher runs it; the races are of a fifth of a second."""

import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys

import pytest

from airrace.commands.app import main
from airrace.common.resources import models_path
from airrace.league import command as module
from airrace.league import proof, sandbox
from airrace.league.season_files import ranking_of
from airrace.league.worker import result_digest
from tests.league.entries import make_entry
from tests.league.seasons import SECRET, forge, seal
from tests.worlds.processes import descendant, wait_until

NO_SANDBOX = sandbox.why_no_sandbox()
needs_sandbox = pytest.mark.skipif(
    NO_SANDBOX is not None, reason=f"there is no sandbox: {NO_SANDBOX}"
)
SEASON = """\
name: Brief
levels: [1]
tracks: 1
track: hexagon
laps: 1
seed_file: brief.seed
replays: false
scenario_text: "{referee: {time_limit: 0.2}, camera: {width: 160, height: 90}}"
"""
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(models_path().parent)}


def make_season(folder):
    """Writes a season, its seed, and entries: one that flies, and two that are not accepted."""
    (folder / "brief.yaml").write_text(SEASON)
    (folder / "brief.seed").write_text(SECRET)
    make_entry(folder / "herons")
    make_entry(folder / "broken", mine="def make(:\n")
    make_entry(folder / "greedy", "team: A\npackages: {gone-with-the-wind: '1.0'}\n")
    return folder


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return make_season(tmp_path)


@pytest.mark.parametrize(
    "words, sentence",
    [
        (["check", "broken"], "broken/mine.py is no Python: .* at line 1; correct it"),
        (["check", "greedy"], "gone-with-the-wind 1.0 is not installed here"),
        (["check", "nobody"], "There is no entry 'nobody'"),
        (["run", "gone.yaml", "herons"], "There is no season gone.yaml"),
        (["run", "brief.yaml", "broken", "greedy"], "No entry is accepted. .*line 1.*wind"),
        (["run", "brief.yaml", "herons", "./herons"], "Two entries are called herons"),
        (["run", "brief.yaml", "herons", "--workers", "0"], "--workers must be at least 1"),
        (["run", "brief.yaml", "herons", "--resume"], "--resume needs --output"),
        (["run", "brief.yaml", "herons", "--scheduler", "x", "--workers", "1"], "exclude each oth"),
        (["verify", "brief.yaml"], "is no result of a league: .*; name the league.json"),
    ],
)
def test_bad_input_is_answered_in_a_sentence(folder, capsys, monkeypatch, words, sentence):
    monkeypatch.setattr(sandbox, "why_no_sandbox", lambda: None)
    before = sorted(folder.rglob("*"))
    assert main(["league", *words]) == 2
    err = capsys.readouterr().err
    assert re.search(sentence, err) and err.strip().count("\n") == 0, err
    assert sorted(folder.rglob("*")) == before


def test_without_a_sandbox_it_asks_for_unsafe(folder, capsys, monkeypatch):
    monkeypatch.setattr(sandbox, "why_no_sandbox", lambda: "bubblewrap does not run")
    assert main(["league", "run", "brief.yaml", "herons"]) == 2
    err = capsys.readouterr().err
    assert "cannot be isolated on this computer: bubblewrap does not run" in err
    assert "--unsafe" in err
    assert not (folder / "runs").exists()


def test_the_reason_why_there_is_no_sandbox(monkeypatch):
    why = sandbox.why_no_sandbox.__wrapped__
    refused = subprocess.CompletedProcess(
        [], 1, "", "bwrap: No permissions to create a namespace\n"
    )
    monkeypatch.setattr(shutil, "which", lambda name: "/usr/bin/bwrap")
    monkeypatch.setattr(subprocess, "run", lambda *args, **kwargs: refused)
    assert "No permissions to create a namespace" in why()
    monkeypatch.setattr(shutil, "which", lambda name: None)
    assert "apt-get install bubblewrap" in why()


def test_a_check_without_a_flight(folder, capsys):
    assert main(["league", "check", "herons", "--no-flight"]) == 0
    out = capsys.readouterr().out
    for line in ("entry     herons, of team Herons: accepted", "systems   all as shipped"):
        assert line in out


def test_help_teaches(capsys):
    for words in ([], ["run"], ["verify"], ["check"]):
        assert main(["league", *words, "--help"]) == 0
        assert "airrace league" in capsys.readouterr().out
    assert module.EPILOG.count("airrace league") >= 5


def racing(process):
    """Returns the first process that flies a race among the descendants of one."""
    return descendant(process, "airrace.league.entry_race")


@pytest.fixture(scope="module")
def season(tmp_path_factory):
    """The folder of a season whose first race was killed, and what was printed."""
    folder = make_season(tmp_path_factory.mktemp("season"))
    words = ["run", "brief.yaml", "optimal", "broken", "herons", "--workers", "2"]
    process = subprocess.Popen(
        [sys.executable, "-m", "airrace", "league", *words, "--output", "out"],
        cwd=folder,
        env=ENVIRONMENT,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    try:
        wait_until(lambda: racing(process), 120).kill()
        out, err = process.communicate(timeout=600)  # long, for a busy machine
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode == 0, err
    return folder / "out", out, err


@pytest.mark.slow
@needs_sandbox
class TestASeason:
    def test_all_races_were_flown_once(self, season):
        folder, out, err = season
        league = json.loads((folder / "league.json").read_text())
        assert league["complete"] and league["settings"]["safe"]
        assert [(f["entry"], f["leg"]) for f in league["flights"]] == [
            ("optimal", 1),
            ("herons", 1),
        ]
        # The same autonomy, and so the same race.
        assert len({line["sha256"] for line in league["flights"]}) == 1
        assert "ran out of time" in league["flights"][0]["dnf_reason"]
        assert len((folder / "flights.jsonl").read_text().splitlines()) == 2
        assert f"Results: {'out/league.html'}" in out

    def test_a_broken_entry_is_named_and_keeps_no_other_from_flying(self, season):
        folder, _, err = season
        league = json.loads((folder / "league.json").read_text())
        assert "is no Python" in league["settings"]["refused"]["broken"]
        assert "not accepted: broken: " in err
        assert "is no Python" in (folder / "league.html").read_text()

    def test_the_secret_is_nowhere(self, season):
        folder, _, _ = season
        for path in folder.rglob("*"):
            assert not path.is_file() or SECRET.encode() not in path.read_bytes(), path

    @pytest.mark.repeats
    def test_resumed(self, season, tmp_path, monkeypatch, capfd):
        """Only what is missing is flown, and it comes out equal."""
        folder, _, _ = season
        copy = tmp_path / "out"
        shutil.copytree(folder, copy)
        lines = (copy / "flights.jsonl").read_text().splitlines(keepends=True)
        (copy / "flights.jsonl").write_text(lines[0])
        before = json.loads((copy / "league.json").read_text())
        monkeypatch.chdir(folder.parent)
        words = ["league", "run", "brief.yaml", "optimal", "broken", "herons", "--workers", "1"]
        assert main([*words, "--output", str(copy), "--resume"]) == 0
        assert "1 of 2 races have been flown already" in capfd.readouterr().err
        after = json.loads((copy / "league.json").read_text())
        for league in (before, after):
            del league["files"], league["sha256"]
            for line in league["flights"]:
                line.pop("conduct")  # processor times differ
        assert after == before

    def test_a_forged_result_is_found_by_flying_again(self, season, tmp_path, capsys):
        folder, _, _ = season
        copy = tmp_path / "out"
        shutil.copytree(folder, copy)
        race = copy / "races" / "herons-1" / "race.json"
        figures = {"finished": True, "dnf_reason": None, "mean_lap_s": 5.0, "best_lap_s": 5.0}
        forge(race, lambda data: data.update(figures))
        result = proof.read_result(race)
        rows = [json.loads(row) for row in (copy / "flights.jsonl").read_text().splitlines()]
        for row in rows:
            if row["entry"] == "herons":
                row |= {"result": result, "sha256": result_digest(result)}
        (copy / "flights.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))

        def line(league):
            (forged,) = (f for f in league["flights"] if f["entry"] == "herons")
            forged.update(figures)
            forged["sha256"] = result_digest(result)
            names = [entry["entry"] for entry in league["settings"]["entries"]]
            league["ranking"] = ranking_of(names, league["flights"], league["settings"])

        forge(copy / "league.json", line)
        seal(copy)
        words = ["league", "verify", str(copy / "league.json"), "--entry", "herons"]
        assert main([*words, "--seed_file", str(folder.parent / "brief.seed")]) == 1
        right, note, wrong = capsys.readouterr().out.splitlines()
        assert "league.json was written with the hash " in note
        assert right == "right  all files of 2 races agree"
        assert wrong.startswith("WRONG  race 1 of herons: flown again, ")

    @pytest.mark.repeats
    def test_an_honest_one_is_right(self, season, capsys):
        folder, _, _ = season
        words = ["league", "verify", str(folder / "league.json"), "--entry", "optimal"]
        assert main([*words, "--seed_file", str(folder.parent / "brief.seed")]) == 0
        assert "flown again, is equal to the last bit" in capsys.readouterr().out
