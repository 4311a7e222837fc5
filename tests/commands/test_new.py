"""What `airrace new` makes races as it is."""

import importlib
import json
import shlex
import stat
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.math import RigidTransform

from airrace.commands.app import main
from airrace.league.entry import load_entry
from airrace.league.season import Season, load_season, read_secret
from airrace.scenario import load_scenario
from airrace.systems.sensing.camera_view import CameraView
from airrace.vehicle.camera_info import make_camera_info

BRIEFLY = "referee: {time_limit: 0.3}"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty working directory, whose modules can be imported."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    before = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - before:  # another test may make modules of these names
        if str(getattr(sys.modules[name], "__file__", None)).startswith(str(tmp_path)):
            del sys.modules[name]


def printed_command(capsys) -> list[str]:
    """The words of the command that races it, but for `airrace`."""
    line = capsys.readouterr().out.splitlines()[-1]
    words = shlex.split(line)
    assert words.pop(0) == "airrace"
    return words


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["controller", "detector", "drone", "track"])
def test_what_is_made_is_accepted(kind, folder, capsys):
    name = "my-own_1" if kind in ("drone", "track") else f"new_{kind}"
    assert main(["new", kind, name]) == 0
    command = printed_command(capsys)
    if kind == "drone":
        assert name in (folder / name / "betaflight.txt").read_text().splitlines()[0]
    if "--scenario_text" in command:
        command = [word.replace("{systems", f"{{{BRIEFLY}, systems") for word in command]
    else:
        command += ["--scenario_text", BRIEFLY]
    options = ["--no-meshcat", "--no-report", "--output", "out"]
    assert main([*command, *options]) == 1  # its time is over before it finishes
    race = json.loads((folder / "out" / "race.json").read_text())
    assert "ran out of time" in race["dnf_reason"]
    assert kind not in race or race[kind] == name


@pytest.mark.repeats
@pytest.mark.parametrize("kind", ["controller", "detector"])
def test_a_system_races(kind, folder, capsys):
    name = f"new_{kind}"
    assert main(["new", kind, name]) == 0
    command = printed_command(capsys)
    options = ["--no-meshcat", "--no-report", "--record", "none", "--output", "out"]
    if kind == "controller":  # which needs no pictures
        options += ["--map", "track", "--renderer", "none"]
    else:  # on a short track, by few and small pictures, to save time
        options += ["--track", "hexagon", "--laps", "1"]
        small = "{camera: {width: 640, height: 360, fps: 15}, systems"
        command = [word.replace("{systems", small) for word in command]
    assert main([*command, *options]) == 0
    race = json.loads((folder / "out" / "race.json").read_text())
    assert race["finished"] and race["collisions"] == 0
    assert f"{name}:make" in (folder / "out" / "scenario.yaml").read_text()


def test_an_entry_and_a_season_are_accepted(folder, capsys):
    """What they fly is in tests/league."""
    assert main(["new", "entry", "my-own_1"]) == 0
    assert printed_command(capsys) == ["league", "check", "my-own_1"]
    entry = load_entry(folder / "my-own_1")
    assert entry.config.team == "my-own_1" and len(entry.config.systems) == 6
    assert main(["new", "season", "my-own_1"]) == 0
    assert printed_command(capsys) == ["league", "run", "my-own_1.yaml", "original", "optimal"]
    season = load_season(folder / "my-own_1.yaml")
    assert season == Season(name="my-own_1", seed_file="my-own_1.seed")  # all else by default
    secret = read_secret(folder / "my-own_1.yaml", season)
    assert stat.S_IMODE((folder / "my-own_1.seed").stat().st_mode) == 0o600
    assert main(["new", "season", "another"]) == 0
    assert read_secret(folder / "another.yaml", load_season(folder / "another.yaml")) != secret


def test_a_detector_searches_each_picture_once(folder):
    assert main(["new", "detector", "searches_once"]) == 0
    system = importlib.import_module("searches_once").make(load_scenario())
    searched = []
    system._detector = SimpleNamespace(
        detectMarkers=lambda picture: (searched.append(picture), ((), None, ()))[1]
    )
    context = system.CreateDefaultContext()
    info = make_camera_info(width=64, height=36, fov_y=1.0, X_BC=RigidTransform())
    system.GetInputPort("camera_info").FixValue(context, info)
    for picture, time in enumerate((0.0, 0.1), start=1):
        view = CameraView.of(np.zeros((36, 64), np.uint8))
        system.GetInputPort("camera_view").FixValue(context, view)
        system.GetInputPort("camera_image_time").FixValue(context, [time])
        for later in (0.0, 0.01, 0.02):
            context.SetTime(time + later)
            assert system.GetOutputPort("detections").Eval(context).time == time
        assert len(searched) == picture


@pytest.mark.parametrize(
    "kind, name, words",
    [
        ("drone", "a/b", "cannot be a name here"),
        ("track", "", "cannot be a name here"),
        ("controller", "my-controller", "cannot be a Python module"),
        ("controller", "class", "cannot be a Python module"),
        ("detector", "numpy", "There is a Python module 'numpy' already"),
        ("drone", "taken", "There is taken/vehicle.yaml already"),
        ("track", "taken", "There is taken.yaml already"),
        ("season", "taken", "There is taken.yaml already"),
        ("entry", "a b", "cannot be a name here"),
    ],
)
def test_bad_names(kind, name, words, folder, capsys):
    (folder / "taken").mkdir()
    (folder / "taken" / "vehicle.yaml").write_text("mine")
    (folder / "taken.yaml").write_text("mine")
    assert main(["new", kind, name]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1 and words in err
    assert (folder / "taken.yaml").read_text() == "mine"
    assert (folder / "taken" / "vehicle.yaml").read_text() == "mine"
