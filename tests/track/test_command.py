import re
import subprocess
import sys

import pytest
import yaml

from airrace.commands.app import main as command
from airrace.track import load_track
from airrace.track.command import to_yaml
from airrace.track.generator import generate_square_track, generate_track


def main(words):
    """Calls `airrace track`; returns its exit code."""
    return command(["track", *words])


def test_prints_a_track_that_can_be_loaded(tmp_path, capsys):
    assert main(["--seed", "7", "--gates", "10"]) == 0
    text = capsys.readouterr().out
    file = tmp_path / "t.yaml"
    file.write_text(text)
    assert load_track(str(file)) == generate_track(7, 10)
    # The first line names the command that made it.
    command = re.fullmatch(r"# airrace track (.*)", text.splitlines()[0])[1]
    assert command.startswith("--seed 7 --gates 10 --direction ")
    assert main(command.split()) == 0
    assert capsys.readouterr().out == text


@pytest.mark.parametrize("options", [["--gates", "10"], []])
def test_prints_a_course_of_square_gates(tmp_path, capsys, options):
    assert main(["--kind", "square", "--seed", "7", *options]) == 0
    text = capsys.readouterr().out
    file = tmp_path / "t.yaml"
    file.write_text(text)
    assert load_track(str(file)) == generate_square_track(7, 10 if options else None)
    command = re.fullmatch(r"# airrace track (.*)", text.splitlines()[0])[1]
    assert command.startswith("--kind square --seed 7 --gates ")
    assert main(command.split()) == 0
    assert capsys.readouterr().out == text


def test_what_is_not_usual_is_written_too():
    track = generate_track(0, 8)
    track.gates[2].pylon_spacing = 11.5
    assert yaml.safe_load(to_yaml(track, "changed"))["gates"][2]["pylon_spacing"] == 11.5


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["--gates", "9"], "9 gates"),
        (["--gates", "22"], "22 gates"),
        (["--seed", "-1"], "negative"),
        (["--gates", "8", "--plot", "no/such/folder/t.png"], "cannot be written"),
        (["--gates", "8", "--plot", "t.xyz"], "ending"),
    ],
)
def test_bad_input_is_one_sentence(arguments, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert words in output.err
    assert output.err.startswith("airrace: ") and output.err.count("\n") == 1


def test_runs_as_a_module():
    """airrace.track is loaded a second time there; its classes must not mix."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-m", "airrace", "track", "--seed", "2", "--gates", "8"],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert yaml.safe_load(done.stdout)["name"] == generate_track(2, 8).name
