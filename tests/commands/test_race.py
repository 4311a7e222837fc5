import dataclasses as dc
import datetime
import json
import os
import re
import subprocess
import sys
import types
from pathlib import Path

import pytest
import yaml

from airrace.commands.app import main as command
from airrace.common import files
from airrace.common.errors import UserError
from airrace.common.resources import models_path
from airrace.diagrams import race, warm_up
from airrace.diagrams.race_command import EPILOG, RaceOptions, race_scenario, report_after
from airrace.scenario import load_scenario, scenario_yaml
from tests.worlds.cases import first
from tests.worlds.command_line import parse


def main(words):
    """Calls `airrace race`; returns its exit code."""
    return command(["race", *words])


# Half of the usual, to save time.
FEWER_PICTURES = ["--scenario_text", "camera: {fps: 15}"]
SHORT = ["--no-meshcat", "--scenario_text", "referee: {time_limit: 0.2}"]


def track_with(change):
    data = yaml.safe_load((models_path() / "tracks" / "student-airrace.yaml").read_text())
    change(data)
    return yaml.safe_dump(data)


def drone_with(change=None, sdf=None):
    """The files of the Default drone, changed."""
    default = models_path() / "default"
    data = yaml.safe_load((default / "vehicle.yaml").read_text())
    data.update(change or {})
    text = (default / "default.sdf").read_text()
    return {"vehicle.yaml": yaml.safe_dump(data), "default.sdf": (sdf or str)(text)}


def rotors_with(change):
    """The Default drone's rotors, changed one by one."""
    data = yaml.safe_load(drone_with()["vehicle.yaml"])
    return {"rotors": [{**rotor, **change(*rotor["position"][:2])} for rotor in data["rotors"]]}


def twice(sdf):
    model = sdf[sdf.index("<model") : sdf.index("</sdf>")]
    other = model.replace('"drone"', '"two"')
    return f'<sdf version="1.9"><world name="both">{model}{other}</world></sdf>'


# Folders of drones that cannot fly, and what is said about them.
DRONES = {
    "negative": (drone_with({"mass": -1.0}), "vehicle.yaml cannot fly: mass must be a positive"),
    "nan": (drone_with({"inertia": [0.01, float("nan"), 0.01]}), "inertia needs three positive"),
    "flat": (drone_with({"inertia": [0.01, 0.01, 0.03]}), "inertia breaks the triangle"),
    "same_way": (
        drone_with(rotors_with(lambda x, y: {"direction": "cw"})),
        "its rotors cannot produce thrust and all three moments",
    ),
    "nose_heavy": (
        drone_with(rotors_with(lambda x, y: {"position": [x - 0.2, y, 0.0]})),
        "its rotors cannot hold it level",
    ),
    "nameless": (drone_with({"name": " "}), "vehicle.yaml cannot fly: it has no name"),
    "typo": (drone_with({"wings": 2}), "vehicle.yaml does not fit its schema: wings is unknown"),
    "no_sdf": (drone_with({"model": "gone.sdf"}), "no_sdf/gone.sdf, which does not exist"),
    "long_name": (drone_with({"model": "x" * 300}), "which does not exist"),
    "garbage": (drone_with(sdf=lambda text: "garbage"), "default.sdf cannot be used: .*XML"),
    "cut_off": (drone_with(sdf=lambda text: text[:900]), "default.sdf cannot be used: .*XML"),
    "no_body": (
        drone_with(sdf=lambda text: text.replace('"body"', '"hull"')),
        "default.sdf cannot be used: it must be one link, named 'body'",
    ),
    "static": (
        drone_with(sdf=lambda text: text.replace("<link", "<static>true</static><link")),
        "must be one link, named 'body', without joints",
    ),
    "two": (drone_with(sdf=twice), "default.sdf cannot be used: it must be one link"),
    "untouchable": (
        drone_with(sdf=lambda text: re.sub("<collision.*</collision>", "", text, flags=re.S)),
        "has nothing to stand on: its SDF file needs collision geometries",
    ),
    "not_finite": (
        drone_with(sdf=lambda text: text.replace("<mass>1.0", "<mass>nan")),
        "default.sdf must have the moments of inertia of its vehicle.yaml, 0.01,",
    ),
    "heavy": (
        drone_with(sdf=lambda text: text.replace("<mass>1.0", "<mass>1.1")),
        "default.sdf has a mass of 1.1 kg, and its vehicle.yaml 1 kg; make them equal",
    ),
}
FILES = {
    "nan.yaml": track_with(lambda d: d["gates"][4].update(heading_deg=float("nan"))),
    "overlap.yaml": track_with(
        lambda d: d["gates"][3].update(left_pylon=[53.0, 20.0], heading_deg=90.0)
    ),
    "words.yaml": "just words",
    "broken.yaml": "gates: [1, 2",
    "scenario.yaml": "Mine: {laps: 2}",
    "nan_scenario.yaml": "Defaults: {explorer: {max_speed: .nan}}",
    "bad_scenario.yaml": "Defaults: {camera: {lens: fisheye}}",
    "picture.yaml": b"\x89PNG\xff\x00",
    "file": "mine",
    "flown/race.json": "{}",
    "aborted/scenario.yaml": "",
    **{
        f"{drone}/{name}": text
        for drone, (files, _) in DRONES.items()
        for name, text in files.items()
    },
}

# Arguments, and what the one sentence on standard error must say.
BAD = [
    (
        ["-d", "Nimbus"],
        "no drone named 'Nimbus' and no file Nimbus/vehicle.yaml; choose from "
        "Default, StarOne, or name the folder",
    ),
    (["--scenario_text", "drone: flown"], "no file flown/vehicle.yaml"),
    (["-d", "x" * 300], "no drone named"),
    *((["-d", drone], words) for drone, (_, words) in DRONES.items()),
    (["--lockstep"], "--lockstep is for hardware in the loop: add -s HITL"),
    (["--companion", "user@10.0.0.2"], "--companion is for hardware in the loop: add -s HITL"),
    (["--track", "none"], "no track named 'none' .* are: .*student-airrace"),
    (["--track", "none.yaml"], "no track named 'none.yaml' and no such file"),
    (["--track", "."], "no track named '.'"),
    (["--track", "x" * 300], "no track named"),
    (["--track", "nan.yaml"], "nan.yaml cannot be raced: a number of gate 5 .* not finite"),
    (["--track", "overlap.yaml"], "overlap.yaml cannot be raced: gates 3 and 4 overlap"),
    (["--track", "words.yaml"], "words.yaml does not fit its schema: it must be a mapping"),
    (["--track", "broken.yaml"], "broken.yaml is not valid YAML at line 1"),
    (["--track", "picture.yaml"], "picture.yaml is not a text file"),
    (["--laps", "0"], "laps must be at least 1, not 0"),
    (["--laps", "-3"], "laps must be at least 1, not -3"),
    (["--seed", "-1"], "seed must be at least 0, not -1"),
    (["--realtime_rate", "-1"], "--realtime_rate. must be at least 0"),
    (["--realtime_rate", "nan"], "target_realtime_rate must be a finite number"),
    (
        ["--scenario_file", "none"],
        "no scenario named 'none' .* are: grand_prix, levels, original, races",
    ),
    (["--scenario_file", "scenario.yaml"], "no 'Defaults' at its top level, only: Mine"),
    (["--scenario_file", "races", "--scenario_name", "None"], "only: Defaults, NoNoise, "),
    (["--limits", "fast"], r"The limits \(--limits, planner.limits\) .fast. are not understood"),
    (
        ["--scenario_text", "{planner: {thrust_share: 0.2}}", "--no-meshcat"],
        "rotors of Default cannot hold a hover. Raise planner.thrust_share.",
    ),
    (
        ["--scenario_text", "{planner: {thrust_share: 1.01}}"],
        "planner.thrust_share must be at most 1, not 1.01",
    ),
    (
        ["--scenario_text", "planner: {lap: rest_to_rest}"],
        "'rest_to_rest' is for minimum-snap laps: set trajectory .-t. to 3, 4 or 6",
    ),
    (["--scenario_file", "nan_scenario.yaml"], "explorer.max_speed must be a finite number"),
    (["--scenario_file", "bad_scenario.yaml"], "bad_scenario.yaml .*camera.lens is unknown"),
    (["--scenario_name", "Vtk"], "--scenario_name needs --scenario_file"),
    (["--level", "2", "--scenario_file", "races"], "--level is a scenario of its own: leave out"),
    (["--level", "0", "--scenario_name", "Wind"], "--level is a scenario of its own: leave out"),
    (["--scenario_text", "{lapse: 3}"], "--scenario_text '{lapse: 3}' .*lapse is unknown"),
    (["--scenario_text", "explorer: {max_sped: 3}"], "explorer.max_sped is unknown; there are:"),
    (["--scenario_text", "laps: many"], "laps must be a whole number, not 'many'"),
    (["--scenario_text", "laps: 3\nseed: [\n"], "not valid YAML"),
    (["--scenario_text", "systems: {explorer: nobody:Box}"], "systems.explorer: .*No module named"),
    (["--scenario_text", "systems: {pilot: a:b}"], "systems.pilot is not a system of the autonomy"),
    (
        ["--scenario_text", "rotor_failures: [{rotor: 9, time: 1.0}]"],
        "rotor_failures: there is no rotor 9; the Default has rotors 1 to 4",
    ),
    (
        ["--scenario_text", "disturbances: {wind: {gust_rms: 1.0}}"],
        "wind acts through drag: set disturbances.drag, e.g. to 1",
    ),
    (["--output", "file"], "--output file cannot be written to .File exists.; name another"),
    (["--output", "file/below"], "--output file/below cannot be written to"),
    (["--output", "/proc/none/out"], "--output /proc/none/out cannot be written to"),
    (
        ["--output", "flown"],
        "--output flown already holds results .race.json.; name another folder",
    ),
    (["--output", "aborted"], "--output aborted already holds results"),
    (["--graphviz", "none/race.dot"], "--graphviz none/race.dot cannot be written"),
    (["--graphviz", "/proc/race.dot"], "--graphviz /proc/race.dot cannot be written"),
    (["--graphviz", "."], "--graphviz . cannot be written .Is a directory"),
]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working directory with good and bad files in it."""
    for name, content in FILES.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    monkeypatch.chdir(tmp_path)
    return tmp_path


def tree(folder):
    return {str(p.relative_to(folder)): p.is_file() and p.read_bytes() for p in folder.rglob("*")}


def airrace(*args, **kwargs):
    """Runs the program as its users do; returns what subprocess.run() does."""
    # Beside airrace/ whatever the working directory is.
    environment = {**os.environ, "PYTHONPATH": str(models_path().parent)}
    return subprocess.run(
        [sys.executable, "-m", "airrace", "race", *args],
        capture_output=True,
        text=True,
        timeout=60,
        env=environment,
        **kwargs,
    )


class TestBadInput:
    @pytest.mark.parametrize("args, words", BAD, ids=[" ".join(a)[:50] for a, _ in BAD])
    def test_one_sentence_and_nothing_left(self, folder, monkeypatch, capsys, args, words):
        def take_off(*args):
            pytest.fail("flies")

        monkeypatch.setattr(race, "Simulator", take_off)
        if "--output" in args:
            monkeypatch.setattr(warm_up, "compile_apart", take_off)
        before = tree(folder)
        assert main([*args, "--no-meshcat"]) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert err.startswith("airrace: ") and err.count("\n") == 1 and err.endswith("\n")
        assert re.search(words, err), err
        assert tree(folder) == before

    @pytest.mark.slow
    def test_the_process(self, folder):
        before = tree(folder)
        process = airrace("-d", "not_finite", cwd=folder)  # whose file Drake's own parser reads
        assert process.returncode == 2 and process.stdout == ""
        assert process.stderr.startswith("airrace: ") and process.stderr.count("\n") == 1
        assert tree(folder) == before

    @pytest.mark.parametrize(
        "args, words",
        [
            (["-t", "5"], 'Invalid value "5" for -t. Choose from: "3", "4", "6", "optimal".'),
            (["-s", "ROS"], 'Invalid value "ROS" for -s. Choose from: "SITL", "HITL", "MAVLINK".'),
            (["--renderer", "crayon"], 'Invalid value "crayon" for --renderer.'),
            (["--renderer", "plaar"], 'Did you mean "planar"?'),
            (["--level", "5"], 'Invalid value "5" for --level. Choose from: 0, 1, 2, 3, 4.'),
            (["--laps", "abc"], "abc is no whole number."),
            (["--laps", "2.5"], "Invalid value for --laps: 2.5 is no whole number."),
            (["--seed"], "--seed requires an argument."),
            (["--realtime_rate", "fast"], 'unable to convert "fast" into float.'),
            (["--wings", "2"], "Unknown option: --wings."),
            (["--lap", "2"], "Did you mean --laps?"),
            (["mine.yaml"], "'mine.yaml' is too much"),
        ],
    )
    def test_what_the_parser_refuses(self, folder, capsys, args, words):
        assert main(args) == 2
        out, err = capsys.readouterr()
        assert out == "" and err.count("\n") == 1
        assert err.startswith("airrace: ") and words in err
        assert err.endswith(" See airrace race --help.\n")

    def test_no_port_for_meshcat(self, folder, monkeypatch, capsys):
        def no_port(parameters):
            raise RuntimeError("Meshcat failed to open a websocket port.")

        monkeypatch.setattr("airrace.visualization.meshcat_page.Meshcat", no_port)
        before = tree(folder)
        assert main([]) == 2
        out, err = capsys.readouterr()
        assert out == "" and err.count("\n") == 1
        assert "failed to open a websocket port" in err and "--no-meshcat" in err
        assert tree(folder) == before

    def test_an_interrupt_before_the_race(self, folder, monkeypatch, capsys):
        def interrupt(args):
            raise KeyboardInterrupt

        monkeypatch.setattr("airrace.commands.race.race_scenario", interrupt)
        assert main([]) == 1
        assert capsys.readouterr().err == "airrace: interrupted\n"


class TestOptions:
    def resolve(self, *args):
        return race_scenario(parse("race", args))

    def test_defaults(self):
        scenario = self.resolve()
        assert (scenario.track, scenario.drone) == ("student-airrace", "Default")
        assert (scenario.laps, scenario.trajectory, scenario.seed) == (10, "optimal", 0)
        assert scenario.camera.renderer == "planar"
        assert scenario.simulator_config.target_realtime_rate == 0.0

    def test_options_win_over_text_over_file(self, tmp_path):
        path = tmp_path / "mine.yaml"
        path.write_text("Mine: {laps: 2, seed: 2, trajectory: '3', state_noise: none}")
        mine = ["--scenario_file", str(path), "--scenario_name", "Mine"]
        text = ["--scenario_text", "{seed: 5, trajectory: '4', camera: {renderer: vtk}}"]
        scenario = self.resolve(*mine)
        assert (scenario.laps, scenario.seed, scenario.trajectory) == (2, 2, "3")
        scenario = self.resolve(*mine, *text)
        assert (scenario.laps, scenario.seed, scenario.trajectory) == (2, 5, "4")
        assert scenario.camera.renderer == "vtk"
        scenario = self.resolve(
            *mine,
            *text,
            "-t",
            "6",
            "--seed",
            "0",
            "--renderer",
            "planar",
            "--realtime_rate",
            "1.5",
            "--laps",
            "3",
        )
        assert (scenario.laps, scenario.seed, scenario.trajectory) == (3, 0, "6")
        assert scenario.camera.renderer == "planar" and scenario.state_noise == "none"
        assert scenario.simulator_config.target_realtime_rate == 1.5

    def test_a_level_is_a_shipped_scenario(self):
        for level in range(5):
            scenario = self.resolve("--level", str(level), "--laps", "3")
            expected = load_scenario(filename="levels", scenario_name=f"Level{level}")
            expected.laps = 3
            assert scenario_yaml(scenario) == scenario_yaml(expected)
        path = models_path() / "scenarios" / "levels.yaml"
        assert list(yaml.safe_load(path.read_text())) == [f"Level{n}" for n in range(5)]
        scenario = self.resolve("--level", "3", "--scenario_text", "camera: {preset: clean}")
        assert scenario.camera.preset == "clean" and scenario.disturbances.drag == 1.0

    def test_help_lists_everything(self, capsys, monkeypatch):
        monkeypatch.setenv("COLUMNS", "80")
        assert main(["--help"]) == 0
        text = capsys.readouterr().out
        assert max(map(len, text.splitlines())) <= 80
        assert all(f"--{field.name}" in text for field in dc.fields(RaceOptions))
        assert "--no-meshcat" in text and "--no-report" in text
        # Every default, and it is the one that the scenario has.
        text = " ".join(text.replace("│", " ").split())
        for default in (
            "Default",
            "SITL,",
            "optimal",
            "student-airrace",
            "10",
            "0",
            "planar",
            "runs/<UTC time>-<track>-<drone>-<t>",
            "yes",
            "Defaults",
        ):
            assert f"(default: {default}" in text
        for word in (
            "examples:",
            "race.json",
            "map.json",
            "scenario.yaml",
            "race.html",
            "Exit codes: 0 finished, 1 did not finish, 2 bad input.",
        ):
            assert word in text

    def test_the_examples_of_the_help_are_good(self):
        examples = re.findall(r"^  airrace race(.*?)(?:   .*)?$", EPILOG, re.M)
        assert len(examples) >= 4
        for example in examples:
            words = re.findall(r"'[^']*'|\S+", example)
            args = [word.strip("'") for word in words]
            if "my_track.yaml" not in args and "runs/NAME/scenario.yaml" not in args:
                self.resolve(*args)


@pytest.mark.repeats
def test_the_reference_track(folder, capsys):
    """From pixels: explored, mapped and raced."""
    assert main(["--laps", "1", *FEWER_PICTURES, "--no-meshcat", "--output", "out"]) == 0
    data = json.loads((folder / "out" / "race.json").read_text())
    assert data["finished"] and data["collisions"] == 0
    assert data["exploration"]["success"] and data["exploration"]["gates_found"] == 10
    assert len(data["laps"]) == 1 and len(data["laps"][0]["gate_times_s"]) == 10
    assert data["laps"][0]["time_s"] < 20.75  # what a point mass takes through the midpoints
    gates = json.loads((folder / "out" / "map.json").read_text())["gates"]
    assert [gate["gate"] for gate in gates] == list(range(1, 11))
    out, err = capsys.readouterr()
    assert "(the original system, from rest to rest: mean 40.60 s)" in out and err == ""


@pytest.mark.repeats
def test_the_other_drone(folder, hexagon):
    options = ["-d", "StarOne", "--track", hexagon, "--laps", "1", "--no-meshcat", "--no-report"]
    assert main([*options, *FEWER_PICTURES, "--output", "out"]) == 0
    data = json.loads((folder / "out" / "race.json").read_text())
    assert data["drone"] == "StarOne"
    assert data["finished"] and data["collisions"] == 0
    assert data["exploration"]["success"] and data["exploration"]["gates_found"] == 6


class TestOutput:
    @pytest.mark.slow
    def test_the_default_folder(self, folder, hexagon, capsys, monkeypatch):
        """Named after a track that may be called anything, and never shared."""
        noon = datetime.datetime(2026, 5, 4, 12, tzinfo=datetime.UTC)
        clock = types.SimpleNamespace(now=lambda zone: noon.astimezone(zone))
        monkeypatch.setattr(
            files, "datetime", types.SimpleNamespace(UTC=datetime.UTC, datetime=clock)
        )
        data = json.loads(Path(hexagon).read_text())
        (folder / "mine.yaml").write_text(json.dumps({**data, "name": "../my Track/[é]"}))
        for _ in range(2):
            assert main(["--track", "mine.yaml", "-t", "3", "--no-report", *SHORT]) == 1
        folders = sorted((folder / "runs").iterdir())
        name = "20260504T120000Z-..-my-Track-é--Default-3d"
        assert [path.name for path in folders] == [name, f"{name}-2"]
        for path in folders:
            assert json.loads((path / "race.json").read_text())["track"] == "../my Track/[é]"
            scenario = load_scenario(filename=str(path / "scenario.yaml"))
            assert scenario.track == str(folder / "mine.yaml")
        out = capsys.readouterr().out
        assert {line for line in out.splitlines() if line.startswith("Results")} == {
            f"Results: {path.relative_to(folder)}" for path in folders
        }

    @pytest.mark.slow
    def test_a_drone_of_ones_own(self, folder, monkeypatch):
        """It may be called anything, and flies again from any folder."""
        (folder / "my_drone").mkdir()
        for name, text in drone_with({"name": "../my Drone"}).items():
            (folder / "my_drone" / name).write_text(text)
        assert main(["-d", "my_drone/", "--no-report", *SHORT]) == 1
        (path,) = (folder / "runs").iterdir()
        assert path.name.endswith("-student-airrace-..-my-Drone-optimal")
        assert json.loads((path / "race.json").read_text())["drone"] == "../my Drone"
        left = path / "scenario.yaml"
        assert load_scenario(filename=str(left)).drone == str(folder / "my_drone")
        monkeypatch.chdir(path)
        again = ["--scenario_file", str(left), "--no-meshcat", "--no-report", "--output", "again"]
        assert main(again) == 1
        assert (path / "again" / "scenario.yaml").read_text() == left.read_text()

    @pytest.mark.slow
    def test_a_folder_of_ones_own(self, folder, capsys):
        (folder / "mine" / "notes").mkdir(parents=True)
        assert main(["--output", "mine", *SHORT]) == 1
        assert {p.name for p in (folder / "mine").iterdir()} == {
            "notes",
            "scenario.yaml",
            "map.json",
            "map_statistics.json",
            "race.json",
            "race.mcap",
            "report.html",
        }
        assert not (folder / "runs").exists()
        before = tree(folder)
        assert main(["--output", "mine", *SHORT]) == 2
        assert "already holds results" in capsys.readouterr().err
        assert tree(folder) == before

    @pytest.mark.slow
    def test_graphviz(self, folder):
        assert main(["--graphviz", "race.dot", "--output", "out", "--no-report", *SHORT]) == 1
        dot = (folder / "race.dot").read_text()
        assert dot.startswith("digraph") and "geometric_controller" in dot

    @pytest.mark.slow
    def test_meshcat_leaves_a_replay(self, folder, capsys):
        brief = ["--no-report", "--scenario_text", "referee: {time_limit: 0.2}"]
        assert main(["--output", "out", *brief]) == 1
        assert "Watch it at http://localhost:" in capsys.readouterr().out
        assert "</html>" in (folder / "out" / "race.html").read_text()

    @pytest.mark.slow
    @pytest.mark.parametrize("reader", first(["| head -n 1", "| true", ">/dev/full", ">&-"]))
    def test_nobody_reads(self, folder, reader):
        """The race is flown to its end all the same, without a complaint."""
        command = (
            f'set -o pipefail; "$0" -m airrace race --output out --no-meshcat --no-report'
            f' --scenario_text "referee: {{time_limit: 1.0}}" {reader}'
        )
        process = subprocess.run(
            ["bash", "-c", command, sys.executable],
            capture_output=True,
            text=True,
            timeout=60,
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(models_path().parent)},
        )
        assert process.stderr == ""
        assert process.returncode == 1
        reason = json.loads((folder / "out" / "race.json").read_text())["dnf_reason"]
        assert reason.startswith("ran out of time")

    @pytest.mark.slow
    def test_a_box_that_raises_is_told_in_one_sentence_and_its_own_lines(self, folder):
        """It is the student's bug: the place matters, and it is not among thirty of ours."""
        (folder / "systems").mkdir()
        (folder / "systems" / "my_boxes.py").write_text(
            "from airrace.systems.planning.trajectory_tracker import TrajectoryTracker\n"
            "class Tracker(TrajectoryTracker):\n"
            "    def __init__(self, scenario):\n"
            "        super().__init__()\n"
            "    def _calc_reference(self, context, output):\n"
            "        if context.get_time() > 0.5:\n"
            "            raise ValueError('a mistake')\n"
            "        super()._calc_reference(context, output)\n"
        )
        process = subprocess.run(
            [
                sys.executable,
                "-m",
                "airrace",
                "race",
                "--output",
                "out",
                "--no-meshcat",
                "--no-report",
                "--scenario_text",
                "systems: {trajectory_tracker: my_boxes:Tracker}",
            ],
            capture_output=True,
            text=True,
            timeout=60,
            cwd=folder,
            env={**os.environ, "PYTHONPATH": f"{models_path().parent}:{folder / 'systems'}"},
        )
        assert process.returncode == 1
        mistake = (
            "my_boxes.Tracker._calc_reference() raised ValueError: a mistake (my_boxes.py, line 7)"
        )
        place, line, sentence = process.stderr.splitlines()[-3:]
        assert 'my_boxes.py", line 7' in place and line.strip() == "raise ValueError('a mistake')"
        assert sentence == f"airrace: {mistake}; the whole traceback is in out/error.txt."
        assert "race/__init__.py" not in process.stderr
        assert "race/__init__.py" in (folder / "out" / "error.txt").read_text()
        data = json.loads((folder / "out" / "race.json").read_text())
        assert data["dnf_reason"] == f"stopped by an error: {mistake}"


@pytest.mark.parametrize("error", [RuntimeError("no fonts"), UserError("report.html is full.")])
def test_a_report_that_cannot_be_written_is_a_line(tmp_path, monkeypatch, error):
    def fail(folder):
        raise error

    monkeypatch.setattr("airrace.analysis.report.write_report", fail)
    lines = []
    with report_after(tmp_path, str, lines.append):
        pass
    reason = str(error).rstrip(".")
    assert lines == [f"There is no report.html ({reason}); try airrace report {tmp_path}."]
    with pytest.raises(KeyError), report_after(tmp_path, str, lines.append):
        raise KeyError  # what ended the race is what counts
    assert len(lines) == 1
