import json
import os

import numpy as np
import pytest
from rich.console import Console

from airrace.common.errors import UserError
from airrace.common.processes import ONE_THREAD
from airrace.rendering.vtk.vtk_renderer import check_vtk_available
from airrace.track import load_track
from airrace.vehicle import DRONES, load_vehicle
from benchmarks import control, exploration, growth, race_speed, tracks, trajectories, vtk_frame
from benchmarks.control_tables import despin_time, recovery_tables, tracking_tables
from benchmarks.experiments import loss, recovery, tracking
from benchmarks.fresh import in_fresh_processes, one_thread_each
from benchmarks.trajectory_tables import optimal_table
from tests.worlds.reference_laps import load_course
from tests.worlds.rotor_check import rotor_shares


def printed(tables):
    console = Console(width=200)
    with console.capture() as capture:
        for table in tables:
            console.print(table)
    return capture.get()


def end_after_a_second(monkeypatch, benchmark):
    """Makes a benchmark's races run out of time on the pad."""
    load = benchmark.load_scenario

    def load_a_short_one():
        scenario = load()
        scenario.referee.time_limit = 1.0
        return scenario

    monkeypatch.setattr(benchmark, "load_scenario", load_a_short_one)


def test_recovers_from_upside_down_in_any_process():
    jobs = [("Default", "none", index) for index in (0, 5)]
    rows = control.run([(recovery, job) for job in jobs], workers=1)
    assert rows[0] == recovery(*jobs[0])
    assert max(row["hover_s"] for row in rows) <= 3.0
    assert max(row["height_lost_m"] for row in rows) < 12.0
    assert "2/2" in printed(recovery_tables(rows))


def test_feed_forward_tracks_better():
    cases = {"nominal": "", "feed-forward off": "controller: {feed_forward: false}"}
    rows = [
        tracking("Default", case, noise, "Defaults", text, 0, duration=1.0)
        for case, text in cases.items()
        for noise in ("none", "reference")
    ]
    assert rows[2]["rms_m"] > 3.0 * rows[0]["rms_m"]
    assert rows[0]["rms_m"] < 0.05
    assert "feed-forward off" in printed(tracking_tables(rows))


def test_an_octocopter_flies_on_without_a_rotor():
    row = loss("StarOne", [3], 0.25, 0.0)
    assert row["can_fly"] and row["end"] is None
    assert row["deviation_m"] < 0.5
    assert row["found_after_s"] < 0.05
    json.dumps(row, allow_nan=False)


@pytest.mark.parametrize("drone", DRONES)
def test_yaw_stops_no_sooner_than_its_rotors_can(drone):
    vehicle, _ = load_vehicle(drone)
    # Half of the rotors carry the weight, and all turn the same way.
    moment = vehicle.mass * 9.81 * vehicle.rotors[0].torque_ratio
    assert np.isclose(despin_time(vehicle, 10.0), vehicle.inertia[2] * 10.0 / moment)


def test_every_section_has_jobs_and_tables():
    assert set(control.SECTIONS) == set(control.TABLES)
    for jobs in control.SECTIONS.values():
        assert len(jobs(True)) <= len(jobs(False))


def test_generated_tracks_are_measured(capsys):
    assert tracks.main(["--seeds", "3", "--gates", "8"]) == 0
    assert "Generated tracks" in capsys.readouterr().out
    row = tracks.measure(0, 10, "right")
    assert row["fault"] is None and row["gates"] == len(row["legs_m"]) == 10
    assert "9 gates" in tracks.measure(0, 9)["fault"]


def test_an_exploration_in_a_table():
    row = {"seed": 2, **exploration.explore_generated(2)}
    assert row["failure"] is None and row["wrong_gaps"] == 0 and row["room_m"] > 1.0
    json.dumps(row, allow_nan=False)
    lost = row | {"failure": "found 3 of 8 gates", "time_s": None}
    text = printed([exploration.summary([row, lost])])
    assert "1 (50.0%)" in text and "FLY_TO_GATE 16" in text


def test_room_to_pylons():
    track = load_track("student-airrace")
    for height, room in (
        (0.0, 8.0 - 1.7),
        (6.25, 8.0 - 1.25),
        (9.0, 8.0 - 0.425),
        (16.0, np.hypot(8.0, 4.0)),
    ):
        path = np.array([[20.0, 13.0, height]])  # 8 m left of gate 1
        assert np.isclose(exploration.clear_of_pylons(path, track, 0.4), room - 0.4)
    inside = np.array([[20.0, 5.5, 6.25]])
    assert np.isclose(exploration.clear_of_pylons(inside, track, 0.4), 0.5 - 1.25 - 0.4)


def test_trajectories_are_measured(tmp_path):
    path = tmp_path / "laps.json"
    assert trajectories.main(["--quick", "--only", "bounds", "--json", str(path)]) == 0
    assert all(row["ok"] for row in json.loads(path.read_text())["bounds"])
    row = trajectories.optimal("StarOne", "original", "windows")
    assert row["ok"] and row["most_share"] < 1.0
    assert "StarOne" in printed([optimal_table([row])])
    json.dumps(row, allow_nan=False)


def test_a_lap_beyond_the_rotors_is_noticed():
    vehicle, _ = load_vehicle("Default")
    midpoints, headings, pylons = load_course()
    lap = trajectories.plan_circuit(
        midpoints, headings, pylons, 3, clearance=2.0, max_speed=60.0, max_acceleration=40.0
    )
    assert rotor_shares(lap, vehicle)[1] > 1.1


def test_every_run_is_a_process_of_its_own():
    assert len({os.getpid(), *in_fresh_processes(os.getpid, [(), ()])}) == 3
    assert list(in_fresh_processes(divmod, [(7, 2), (9, 4)])) == [(3, 1), (2, 1)]


def test_processes_keep_to_one_core(monkeypatch):
    for name in ONE_THREAD:
        monkeypatch.setenv(name, "")  # so that it is as before afterwards
        monkeypatch.delenv(name)
    monkeypatch.setenv("OMP_NUM_THREADS", "3")  # somebody asked for it
    one_thread_each()
    names = [("OPENBLAS_NUM_THREADS",), ("OMP_NUM_THREADS",)]
    assert list(in_fresh_processes(os.getenv, names)) == ["1", "3"]


SHORT = ["--renderer", "none", "--scenario_text", "{referee: {time_limit: 1.0}}"]


def test_speed_is_the_median_of_races(tmp_path, capsys):
    path = tmp_path / "speed.json"
    assert race_speed.main([*SHORT, "--runs", "2", "--json", str(path)]) == 1  # out of time
    assert "medians of 2 races" in capsys.readouterr().out
    first, second = json.loads(path.read_text())["runs"]
    assert first["race"].pop("wall") != second["race"].pop("wall")
    assert first["race"] == second["race"]
    assert first["phases"]["exploration"]["simulated_s"] == pytest.approx(0.9, abs=0.2)
    slower = {"simulated_s": 1.0, "wall_s": 4.0, "cpu_s": 2.0}
    results = [
        {"race": first["race"], "phases": {"laps": slower | {"wall_s": wall}}}
        for wall in (4.0, 0.5, 1.0)
    ]
    laps = next(
        line for line in printed([race_speed.speed_table(results)]).splitlines() if "laps" in line
    )
    numbers = [float(each) for each in laps.replace("│", " ").split()[1:]]
    assert numbers == [1.0, 1.0, 2.0, 1.0, 0.5, 0.25, 2.0]


def test_the_time_of_the_boxes_adds_up(tmp_path, capsys):
    path = tmp_path / "speed.json"
    race_speed.main([*SHORT, "--profile", "--json", str(path)])
    assert "sum of the rows" in capsys.readouterr().out
    phase = json.loads(path.read_text())["runs"][0]["phases"]["exploration"]
    assert sum(box["seconds"] for box in phase["boxes"].values()) == pytest.approx(
        phase["cpu_s"], rel=0.05
    )
    assert phase["boxes"]["GeometricController"]["calls"] > 300


@pytest.mark.parametrize(
    "options, named",
    (
        (["--runs", "0"], "--runs"),
        (["--profile", "--runs", "2"], "--profile"),
        (["--scenario_text", "{laps: x}"], "laps"),
        (["--laps", "0"], "laps"),
    ),
)
def test_race_speed_says_what_it_cannot_do(options, named, capsys):
    try:
        code = race_speed.main(options)
    except SystemExit as e:
        code = e.code
    assert code == 2 and named in capsys.readouterr().err


def test_longer_tracks_are_held_against_shorter_ones():
    rows = [
        {"gates": gates, "finished": gates == 10, "simulated_s": time, "cpu_s": cost * time}
        for gates, time, cost in (
            (10, 80.0, 0.1),
            (20, 160.0, 0.12),
            (10, 90.0, 0.2),
            (20, 170.0, 0.26),
            (10, 85.0, 0.1),
            (20, 150.0, 0.15),
        )
    ]
    text = printed([growth.make_table(rows)])
    assert "3 of 3" in text and "0 of 3" in text
    assert "10.00" in text and "6.67" in text  # times real time
    assert "1.30" in text  # the median of 1.2, 1.3 and 1.5


def test_a_race_for_growth_is_flown_and_timed(monkeypatch):
    end_after_a_second(monkeypatch, growth)
    row = growth.fly(0, 8, 1)
    assert row["gates"] == 8 and not row["finished"]
    assert row["simulated_s"] == pytest.approx(1.0) and 0.0 < row["cpu_s"]
    json.dumps(row, allow_nan=False)


def test_a_frame_of_vtk_is_held_against_a_bare_one():
    try:
        check_vtk_available()
    except UserError as e:
        pytest.skip(str(e))
    result = vtk_frame.measure(1)
    assert {len(times) for times in result.values()} == {1}
    assert "1.00" in printed([vtk_frame.make_table(result)])
