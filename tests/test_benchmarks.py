"""The commands below benchmarks/: each runs, and its table shows what it measured."""

import importlib
import json
import os
import re
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest

from airrace.common.errors import UserError
from airrace.rendering.vtk.vtk_renderer import check_vtk_available
from airrace.vehicle import GRAVITY, load_vehicle
from tests.worlds.untrusted_kind import Kind, WrongResult

ROOT = Path(__file__).parents[1]
COMMANDS = [
    path.stem
    for path in sorted((ROOT / "benchmarks").glob("*.py"))
    if f"python -m benchmarks.{path.stem}" in path.read_text(encoding="utf-8")
]
SHORT = "{referee: {time_limit: 1.0}}"  # the race runs out of time on the pad


def command(name, *options):
    """Runs a benchmark as one would by hand."""
    return subprocess.run(
        [sys.executable, "-m", f"benchmarks.{name}", *map(str, options)],
        cwd=ROOT,
        env=os.environ | {"COLUMNS": "160"},
        capture_output=True,
        text=True,
    )


@pytest.fixture
def run_apart(tmp_path):
    """A function that runs a benchmark; it returns the cells of what is printed, and the JSON."""

    def run(name, *options, code=0):
        file = tmp_path / "figures.json"
        done = command(name, *options, "--json", file)
        assert done.returncode == code, done.stdout + done.stderr
        written = json.loads(file.read_text())
        assert written["command"].startswith(f"python -m benchmarks.{name}")
        assert str(file) not in written["command"] and written["machine"] and written["commit"]
        return read(done.stdout, written)

    return run


@pytest.fixture
def run(run_apart, whole, tmp_path, monkeypatch, capsys):
    """The same in this process, which saves seconds, unless all is run as by hand."""

    def run(name, *options, code=0):
        file = tmp_path / "figures.json"
        found = call(name, *options, "--json", file)
        out, err = capsys.readouterr()
        assert found == code, out + err
        return read(out, json.loads(file.read_text()))

    def in_this_process(jobs, what, **options):
        return [function(*arguments) for function, arguments in jobs]

    monkeypatch.setenv("COLUMNS", "160")
    monkeypatch.setattr(
        importlib.import_module("benchmarks.harness"), "in_processes", in_this_process
    )
    return run_apart if whole else run


def call(name, *options):
    """Calls a benchmark; returns its exit code."""
    return importlib.import_module(f"benchmarks.{name}").main([*map(str, options)])


def read(text, written):
    """Returns the cells of what a benchmark prints, its figures, and all text."""
    cells = [[cell.strip() for cell in line.split("│")[1:-1]] for line in text.splitlines()]
    printed = [row for row in cells if row]
    assert sum(len(table["rows"]) for table in written["tables"]) <= len(printed)
    return printed, written["figures"], text


def rows_of(table, name):
    return [row[1:] for row in table if row[0] == name]


@pytest.mark.parametrize("name", COMMANDS)
def test_each_has_help(name, capsys):
    with pytest.raises(SystemExit) as end:
        call(name, "--help")
    assert end.value.code == 0 and capsys.readouterr().out.startswith("usage: ")


@pytest.mark.repeats
def test_recovery_is_the_same_in_any_process(run_apart):
    options = ("--only", "recovery", "--attitudes", 1)
    figures = run_apart("control", *options, "--workers", 1)[1]
    assert run_apart("control", *options, "--workers", 2)[1] == figures


@pytest.mark.repeats
def test_recovery(run):
    table, figures, _ = run("control", "--only", "recovery", "--attitudes", 1)
    assert len(figures["recovery"]) == len(table) == 4
    for row, (_, _, recovered, worst, *_) in zip(figures["recovery"], table):
        assert row["hover_s"] <= 3.0 and row["height_lost_m"] < 12.0
        assert recovered == "1/1" and worst == f"{row['hover_s']:.2f}"


@pytest.mark.slow
def test_generated_tracks_are_measured(run_apart):
    table, rows, _ = run_apart("tracks", "--seeds", 3, "--gates", 8)
    assert [row["fault"] for row in rows] == 3 * [None]
    assert all(row["gates"] == len(row["legs_m"]) == 8 for row in rows)
    (numbers,) = rows_of(table, "8")
    laps = [row["lap_m"] for row in rows]
    assert numbers[3:6] == [f"{f(laps):.0f}" for f in (np.min, np.median, np.max)]


@pytest.mark.repeats
def test_races_are_put_side_by_side(run):
    options = ("--runs", 1, "--tracks", 1, "--scenario_text", SHORT)
    table, figures, text = run("races", *options, code=1)  # out of time, on the pad
    assert [row["name"] for row in figures["student-airrace"]][:2] == ["optimal", "3-D"]
    (row,) = rows_of(table, "6-D")
    assert row[0] == "0 of 1" and row[1] == "-" and row[-1] == "41.21"
    assert rows_of(table, "level 3")[0][0] == "0 of 1" and "ran out of time" in text


@pytest.mark.repeats
def test_a_network_is_put_beside_the_planner(run):
    """Without exploring: what it is about are the laps."""
    options = ("--levels", 0, "--tracks", 1, "--scenario_text", "{map: track}")
    table, figures, _ = run("policies", *options)
    planner, network = figures
    assert planner["handed_back"] == ""
    assert rows_of(table, "level 0, planner")[0][:2] == ["1 of 1", "-"]
    assert rows_of(table, "level 0, network")[0][0] == "1 of 1"
    vehicle = load_vehicle("Default")[0]
    rotor, weight = vehicle.rotors[0], vehicle.mass * GRAVITY
    speed = np.sqrt(weight / (len(vehicle.rotors) * rotor.thrust_coefficient))
    hover_power = rotor.torque_ratio * weight * speed
    for row in figures:
        (lap,) = row["lap_times_s"]
        assert 1.0 < row["margin_m"] < 5.0
        assert 1.0 < row["energy_j"] / (hover_power * lap) < 10.0


@pytest.mark.repeats
def test_the_originals_races_are_put_beside_ours(run):
    table, figures, _ = run("original", "--laps", 1, "--scenario_text", SHORT)
    assert [row["trajectory"] for row in figures["original"]] == ["3", "4", "6"]
    assert rows_of(table, "4-D")[0][-1] == "41.52"
    kinds = {row["name"]: row["trajectory"] for row in figures["improved"]}
    assert kinds["none: the original's system"] == "3"
    assert kinds["all together: airrace's defaults"] == "optimal"
    assert all("ran out of time" in row["dnf_reason"] for row in figures["improved"])


@pytest.mark.slow
def test_a_track_that_cannot_be_is_a_fault(run):
    _, rows, text = run("tracks", "--seeds", 1, "--gates", 9, code=1)
    assert "9 gates" in rows[0]["fault"] and rows[0]["fault"] in text


@pytest.mark.slow
def test_an_exploration(run):
    table, rows, _ = run("exploration", "--tracks", 1, "--first", 2)
    assert rows[0]["failure"] is None and rows[0]["room_m"] > 1.0
    (numbers,) = rows_of(table, "15")
    room, time = rows[0]["room_m"], rows[0]["time_s"]
    assert numbers[:5] == ["1 of 1", "0", "0", f"{room:.2f}", f"{time:.1f}"]
    assert time < rows[0]["home_s"] and numbers[-2:] == ["-", "-"]


@pytest.mark.repeats
def test_explorations_with_several_lengths_of_a_step(run):
    options = ("--student_airrace", "--tracks", 1, "--first", 2, "--step_length", 5, 25)
    table, rows, text = run("exploration", *options)
    assert [(row["seed"], row["step_length_m"]) for row in rows] == [
        (None, 5.0),
        (2, 5.0),
        (None, 25.0),
        (2, 25.0),
    ]
    for step, reference in (("5", rows[0]), ("25", rows[2])):
        (numbers,) = rows_of(table, step)
        assert numbers[0] == "2 of 2" and numbers[-2] == f"{reference['time_s']:.1f}"
        assert f"states entered with steps of {step} m: CALIBRATE 2, " in text


@pytest.mark.slow
def test_perception(run):
    table, figures, _ = run("perception", "--views", 1, "--frames", 2)
    near = next(row for row in figures["accuracy"] if row["camera"] == "clean")
    assert near["found"] == 1.0 and near["corner_rms_px"] < 0.1
    assert rows_of(table, "clean")[0][2:4] == ["1.000", f"{near['corner_rms_px']:.3f}"]
    assert figures["strays"]["frames"] == 2 and figures["strays"]["strays"] == 0
    assert rows_of(table, "tracked (ms)") == [[f"{figures['time']['tracked (ms)']:.3f}"]]


@pytest.mark.slow
def test_trajectories(run):
    table, figures, _ = run("trajectories", "--quick", "--only", "bounds", "minsnap")
    assert all(row["ok"] for rows in figures.values() for row in rows)
    for row in figures["minsnap"]:
        (numbers,) = rows_of(table, str(row["dimensions"]))
        assert numbers[:2] == [f"{row['duration_s']:.2f}", f"{row['gap']:.1%}"]


@pytest.mark.slow
def test_speed_is_the_median_of_races(run):
    options = ("--renderer", "none", "--scenario_text", SHORT)
    table, figures, text = run("race_speed", *options, "--runs", 2, code=1)  # out of time
    assert "medians of 2 races" in text
    (runs,) = figures["runs"].values()
    first, second = (each["race"] for each in runs)
    assert first.pop("wall") != second.pop("wall")
    assert first == second
    phases = [each["phases"]["exploration"] for each in runs]
    assert phases[0]["simulated_s"] == pytest.approx(0.9, abs=0.2)
    speeds = [phase["simulated_s"] / phase["wall_s"] for phase in phases]
    (numbers,) = rows_of(table, "exploration")
    assert numbers[3] == f"{np.median(speeds):.2f}"
    assert numbers[5:] == [f"{min(speeds):.2f}", f"{max(speeds):.2f}"]


@pytest.mark.repeats
def test_the_interface_of_clients_is_held_to_its_promises(run):
    """Seconds of what takes minutes, with a client that hovers."""
    options = ("--only", "rates", "soak", "malformed", "courses", "reset", "--record", "none")
    options += ("--rate_seconds", 4, "--step", "--seconds", 3)
    options += ("--noise_seconds", 4, "--datagrams", 300, "--resets", 2, "--tracks", 1, "--twice")
    options += ("--client", "benchmarks/grand_prix_client.py", "--time_limit", 2)
    options += ("--vq", 1, "--quirks", "none")
    table, figures, _ = run("grand_prix", *options)
    assert [row[0] for row in rows_of(table, "HIGHRES_IMU")] == ["62"]
    assert len(figures["rates"]) == 8
    sent, heard, gaps = figures["soak"]["messages"]
    assert sent == heard > 1000 and gaps == 0 and figures["soak"]["pictures"][1:] == [0, 0]
    assert sum(figures["malformed"]["noise"].values()) == 300
    (row,) = figures["courses"]
    assert (row["dnf_reason"], row["gates_passed"], row["client"]) == ("ran out of time", 0, None)
    assert row["same"] and rows_of(table, "1")[0][:2] == ["0", "no"]
    assert [row["resets"] for row in figures["reset"]] == [0, 1, 2]


@pytest.mark.slow
def test_a_client_that_is_not_installed_is_named(run, tmp_path):
    options = ("--only", "mavsdk", "--folder", tmp_path)
    _, figures, text = run("grand_prix", *options, code=1)
    assert "mavsdk == " in figures["mavsdk"]["failure"] and "add --install" in text


@pytest.mark.slow
def test_the_cost_of_an_estimator_is_a_ratio(run):
    options = ("--estimators", "truth", "vio", "--scenario_text", SHORT)
    table, figures, _ = run("race_speed", *options, code=1)
    phases = [runs[0]["phases"]["exploration"] for runs in figures["runs"].values()]
    truth, vio = (phase["simulated_s"] / phase["cpu_s"] for phase in phases)
    assert rows_of(table, "vio") == [["exploration", *3 * [f"{vio / truth:.2f}"]]]


@pytest.mark.slow
def test_the_times_of_the_boxes_add_up(run):
    table, figures, _ = run("race_speed", "--scenario_text", SHORT, "--profile", code=1)
    phase = figures["runs"]["truth"][0]["phases"]["exploration"]
    boxes = phase["boxes"]
    seconds = {name: box["seconds"] for name, box in boxes.items()}
    assert sum(seconds.values()) == pytest.approx(phase["cpu_s"], rel=0.05)
    assert min(seconds.values()) >= 0.0
    assert boxes["GeometricController"]["calls"] > 300
    for part in ("Camera: drawing", "ArucoDetector: corners", "Drake: plant step, Simulator"):
        assert seconds[part] > 0.0
    ((total, *_),) = rows_of(table, "sum of the rows")
    assert float(total) == pytest.approx(1e3 * phase["cpu_s"] / phase["simulated_s"], rel=0.05)


@pytest.mark.parametrize(
    "options, named",
    [
        (["race_speed", "--runs", "0"], "--runs: it must be at least 1"),
        (["race_speed", "--profile", "--runs", "2"], "--profile"),
        (["race_speed", "--scenario_text", "{laps: x}"], "laps"),
        (["race_speed", "--laps", "0"], "laps"),
        (["grand_prix", "--only", "courses", "--client", "none.py"], "there is no program none.py"),
        (["at_the_limit", "--only", "none"], "No part's name ends like that"),
        (["tracks", "--json", "nowhere/figures.json"], "nowhere does not exist"),
    ],
    ids=lambda options: " ".join(options) if isinstance(options, list) else "",
)
def test_bad_input_is_one_sentence(options, named, capsys):
    try:
        code = call(*options)
    except SystemExit as e:  # of argparse
        code = e.code
    out, err = capsys.readouterr()
    assert code == 2 and out == "" and named in err


@pytest.mark.slow
def test_a_race_that_somebody_ends_ends_the_benchmark(monkeypatch, capsys):
    ended = {"finished": False, "dnf_reason": "interrupted"}
    monkeypatch.setattr("benchmarks.whole_race.run_race", lambda *args, **options: ended)
    assert call("hitl", "--delays", "0", "--losses", "0") == 1
    assert "not finished" not in capsys.readouterr().out


def test_longer_tracks_are_compared_with_shorter_ones(run):
    table, rows, _ = run("growth", "--runs", 1, "--scenario_text", SHORT, code=1)
    assert [row["gates"] for row in rows] == [10, 20]
    assert all(row["simulated_s"] == pytest.approx(0.9, abs=0.2) for row in rows)
    cost = [row["cpu_s"] / row["simulated_s"] for row in rows]
    (numbers,) = rows_of(table, "20")
    assert numbers[0] == "0 of 1" and numbers[3] == f"{cost[1] / cost[0]:.2f}"


@pytest.fixture
def vtk():
    try:
        check_vtk_available()
    except UserError as e:
        pytest.skip(str(e))


@pytest.mark.repeats
def test_tables_are_measured_for_the_documentation(vtk, tmp_path):
    done = command("documented", "--only", "vtk_frame", "--folder", tmp_path / "measurements")
    assert done.returncode in (0, 1), done.stdout + done.stderr  # 1: slow, on a busy machine
    written = json.loads((tmp_path / "measurements" / "vtk_frame.json").read_text())
    assert written["command"] == "python -m benchmarks.vtk_frame" and written["commit"]
    assert written["tables"] and "figures" not in written


@pytest.mark.slow
def test_a_frame_of_vtk_is_compared_with_a_bare_one(vtk, run):
    table, figures, _ = run("vtk_frame", "--frames", 1)
    bare, colour, _ = (times[0] for times in figures.values())
    assert rows_of(table, "airrace, colour") == [[f"{colour:.1f}", f"{colour / bare:.2f}"]]


@pytest.mark.repeats
def test_another_simulator_is_compared_with_ours(run, tmp_path):
    """It is a shell script here; one that is not installed is named."""
    requirements = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]["peers"]
    missing, other = (re.match(r"[\w-]+", requirement)[0] for requirement in requirements)
    row = {"controller": "PID", "besides": "wind", "position_hz": 100, "attitude_hz": 500}
    row |= {"physics_hz": 240, "integrator": "Euler", "simulated_s": 10.0, "rms_m": 0.05}
    row |= {"cpu_s": 4.0, "wall_s": 8.0}
    python = tmp_path / other / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text(f"#!/bin/sh\necho '{json.dumps({'simulator': 'other 1', 'rows': [row]})}'\n")
    python.chmod(0o755)
    (tmp_path / other / "airrace-requirement").write_text(requirements[1])
    table, figures, text = run("peers", "--runs", 1, "--folder", tmp_path, code=1)
    assert f"{missing}: {requirements[0]} is not in {tmp_path}; add --install." in text
    *ours, theirs = figures["rows"]
    assert [row["rms_m"] < 0.03 for row in ours] == [True, True]
    assert theirs["x_cpu"] == 2.5 and theirs["ours"] == pytest.approx(ours[1]["x_cpu"] / 2.5)
    assert rows_of(table, "other 1")[0][-2:] == ["2.5", f"{theirs['ours']:.2g} times"]


@pytest.mark.repeats
def test_estimators_are_put_beside_the_truth(run):
    options = ("--seeds", 1, "--tracks", 1, "--levels", 1, "--laps", 1)
    short = "{referee: {time_limit: 2.5}}"  # the rotors turn for half a second
    table, figures, _ = run("estimation", *options, "--scenario_text", short, code=1)
    vio, truth = figures["student-airrace"]
    assert (vio["estimator"], truth["estimator"]) == ("vio", "truth")
    assert 0.0 < vio["nees_exploring"] < 20.0 and truth["nees_exploring"] is None
    assert rows_of(table, "vio")[0][0] == "0 of 1"
    assert len(rows_of(table, "level 1")) == 2  # one in each of two tables
    complete, *others = figures["ablations"]
    assert complete == {**vio, "name": "complete"}
    assert len(others) == 7
    for row in others:  # on the pad, no loop is to be closed and no marker is doubtful
        same = row["nees_exploring"] == complete["nees_exploring"]
        assert same == (row["name"] in ("no loop closure", "no robust weights")), row["name"]


@pytest.mark.repeats
def test_steps_of_environments_are_measured(run):
    table, figures, _ = run("envs", "--envs", 20)
    assert [row["envs"] for row in figures["rows"]] == [20]
    for row in figures["rows"]:
        assert row["one"] > 100 and row["all"] > 100 and not row["peers"]
        one, plant, more = rows_of(table, str(row["envs"]))[0][:3]
        assert one == f"{row['one']:,.0f}" and more == f"{row['all']:,.0f}"
        assert plant == f"{20 * row['one']:,.0f}"


def test_each_harm_of_a_broken_file_is_counted(monkeypatch):
    robustness = importlib.import_module("benchmarks.robustness")

    def read(path):
        match path.read_bytes():
            case b"crash":
                raise KeyError("x")
            case b"hang":
                while True:
                    pass
            case b"wrong":
                raise WrongResult("another flight")
            case b"sentence":
                raise UserError("It is broken.")

    inputs = [b"crash", b"hang", b"wrong", b"sentence", b"fine", b"crash"]

    def make(folder):
        (folder / "file").write_bytes(b"fine")
        return folder / "file"

    def mutate(rng, data):
        return inputs.pop(0)

    monkeypatch.setattr(robustness, "KINDS", [Kind("file", make, mutate, read)])
    monkeypatch.setattr(robustness, "_LONGEST", 0.05)
    row = robustness.try_kind("file", 6)
    assert (row["crashes"], row["hangs"], row["wrong"]) == (2, 1, 1)
    (table, found), kept = robustness.show([row])
    assert not kept and found.startswith("file: input 0: KeyError: 'x' (test_benchmarks.py:")
    row = row | {"first": None}
    assert robustness.show([row])[1]


def test_first_flight_sees_when_each_stage_is_over(monkeypatch):
    first_flight = importlib.import_module("benchmarks.first_flight")
    clock = iter(range(10, 100, 10))
    monkeypatch.setattr(first_flight.time, "perf_counter", lambda: float(next(clock)))
    lines = ["Compiling", "[  0.0 s] CALIBRATE: power on", "[  0.5 s] TAKE_OFF: x", "CALIBRATE: "]
    times = first_flight.stages(iter(lines), 5.0)
    assert times["compiled_s"] == 5.0 and times["take_off_s"] == 15.0
    assert np.isnan(times["laps_s"])  # it never came
    rows = [{"way": "clone", "installed_s": 1.0, **times, "take_off_s": first_flight.MOST + 1.0}]
    assert first_flight.show(rows)[1] is False
    rows[0]["take_off_s"] = first_flight.MOST
    assert first_flight.show(rows)[1] is True


def test_the_optimum_says_what_is_missing(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "casadi", None)
    assert call("oracle", "--only", "reference") == 2
    assert "pip install 'airrace[benchmarks]'" in capsys.readouterr().err


@pytest.mark.slow
def test_plans_are_put_beside_the_optimum(run):
    """Where CasADi is installed."""
    pytest.importorskip("casadi")
    options = ("--only", "hexagon", "--plan-only", "--intervals", 5)
    table, figures, _ = run("oracle", *options)
    (row,) = figures["laps"]
    assert row["converged"] and row["optimum_s"] < row["planned_s"] < 1.03 * row["optimum_s"]
    assert abs(row["coarse_s"] / row["optimum_s"] - 1.0) < 0.01
    assert rows_of(table, "hexagon")[0][0] == f"{row['planned_s']:.3f}"


def test_published_courses_are_theirs():
    """Their corners, as published planners have them, and gates that come again."""
    courses = importlib.import_module("benchmarks.published_courses")
    made = {name: make() for name, (make, _) in courses.COURSES.items()}
    assert [len(gates.regions) for gates in made.values()] == [21, 21, 11]
    np.testing.assert_array_equal(
        made["19-gates"].midpoints[1:8], made["19-waypoints"].midpoints[8:15]
    )
    # Where TOGT's own plan passes the triangle, the ends of the tunnel, and the hexagon.
    passed = {1: [-1.1, -0.4063, 2.402], 3: [13.08, 3.187, 1.26], 5: [2.623, -8.924, 1.813]}
    for gate, place in (passed | {8: [3.401, -0.409, 1.108]}).items():
        nearest = made["7-shapes"].regions[gate].nearest(place)
        np.testing.assert_allclose(nearest, place, atol=0.01)


def test_a_flight_of_twice_as_many_intervals_is_the_same():
    optimum = importlib.import_module("benchmarks.quadrotor_optimum")
    states = np.arange(13.0)[:, None] + np.arange(7.0)
    thrusts = np.array([np.tile(np.arange(6.0), (4, 1)), np.tile(np.arange(6.0) + 0.5, (4, 1))])
    flight = optimum.Flight(np.array([1.0, 2.0]), states, thrusts)
    finer = flight.refined(2)
    np.testing.assert_allclose(finer.states[:, ::2], states)
    np.testing.assert_allclose(finer.thrusts[0, :, ::2], thrusts[0])
    np.testing.assert_allclose(finer.thrusts[1, :, 1::2], thrusts[1])
    np.testing.assert_allclose(finer.thrusts[1, :, ::2], finer.thrusts[0, :, 1::2])


def test_what_is_the_same_in_every_lap_is_told_from_what_is_not():
    at_the_limit = importlib.import_module("benchmarks.at_the_limit")
    time = np.arange(5.0, 45.0, 0.01)
    same = 0.03 * np.sqrt(2.0) * np.sin(2.0 * np.pi * time / 10.0)
    gusts = np.random.default_rng(1).normal(0.0, 0.04, (2, len(time) // 20)).repeat(20, axis=1)
    samples = np.column_stack([time, same, *gusts])
    laps = [{"start_s": start, "time_s": 10.0} for start in (10.0, 20.0, 30.0)]
    found = at_the_limit._errors(samples, laps)
    assert found["repeats_m"] == pytest.approx(0.03, abs=0.005)
    assert found["error_m"] == pytest.approx(np.sqrt(0.03**2 + 2 * 0.04**2), rel=0.1)


def test_parts_are_put_beside_all_of_them():
    at_the_limit = importlib.import_module("benchmarks.at_the_limit")
    flown = {"dnf_reason": None, "trajectory": "optimal", "gate_offsets_m": [], "map_rms_m": None}
    flown |= {"finished": True, "collisions": 1, "exploration_s": None, "late_s": 0.002}
    rows = [
        {"name": f"2: {name}", "lap_times_s": [12.0, 11.0, lap, lap], **flown}
        for name, lap in (("all parts", 9.5), ("without any", 9.9))
    ]
    speed = {"all parts": [10.0, 8.0, 9.0], "without any": [10.3, 8.0, 9.9]}
    (laps, cost), passed = at_the_limit.show({"laps": rows, "speed": speed})
    assert passed and [*laps.columns[3].cells] == ["9.50", "9.90"]
    assert [*laps.columns[4].cells] == ["2", "2"] and [*laps.columns[7].cells] == ["1", "1"]
    assert [*cost.columns[2].cells] == ["1.000", "1.030"]
    assert len(at_the_limit.show({"laps": rows, "speed": {"all parts": []}})[0]) == 1


def _sleep_and_tell(folder: str) -> None:
    Path(folder, str(os.getpid())).touch()
    time.sleep(60.0)


@pytest.mark.slow
def test_processes_end_with_a_benchmark_that_is_killed(tmp_path):
    program = (
        "from benchmarks.harness import in_processes\n"
        "from tests.test_benchmarks import _sleep_and_tell\n"
        f"in_processes([(_sleep_and_tell, ({str(tmp_path)!r},))], 'x')\n"
    )
    options = dict(cwd=ROOT, stderr=subprocess.DEVNULL)
    with subprocess.Popen([sys.executable, "-c", program], **options) as main:
        while not (told := [*tmp_path.iterdir()]):
            time.sleep(0.1)
        main.kill()
    worker = int(told[0].name)
    for _ in range(100):
        if not Path(f"/proc/{worker}").exists():
            return
        time.sleep(0.1)
    os.kill(worker, signal.SIGKILL)
    pytest.fail("The worker lives on.")
