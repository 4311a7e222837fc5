"""Races on a map that is given: no camera, no exploration."""

import dataclasses as dc
import json

import numpy as np
import pytest

from airrace.analysis import load_run
from airrace.analysis.along_lap import gate_times
from airrace.commands.app import main as command
from airrace.common.errors import UserError
from airrace.diagrams.race import MakeRace, run_race
from airrace.hitl.hitl_race import prepared
from airrace.scenario import PlannerConfig, Scenario, load_scenario
from airrace.scenario.camera_config import CameraConfig
from tests.worlds.cases import first


def main(words):
    """Calls `airrace race`; returns its exit code."""
    return command(["race", *words])


BLIND = CameraConfig(renderer="none")


# Without `slow`: the fast lane, too, flies a whole race.
def test_a_race_without_a_camera_and_another_on_its_map(hexagon, tmp_path):
    scenario = Scenario(track=hexagon, laps=1, map="track", camera=BLIND)
    (tmp_path / "one").mkdir()
    one = run_race(scenario, tmp_path / "one")
    assert one["finished"] and one["exploration"]["time_s"] < 6.0
    assert one["exploration"]["gates_found"] == 6
    run = load_run(tmp_path / "one")
    assert not len(run.detections)
    # The same without the truth, by the map that it has left, and the same file again.
    output = tmp_path / "two"
    code = main(
        [
            "--track",
            hexagon,
            "--laps",
            "1",
            "--no-meshcat",
            "--no-report",
            "--renderer",
            "none",
            "--map",
            str(tmp_path / "one" / "map.json"),
            "--output",
            str(output),
        ]
    )
    assert code == 0
    two = json.loads((output / "race.json").read_text())
    assert two["mean_lap_s"] == pytest.approx(one["mean_lap_s"], abs=0.05)
    again = load_scenario(filename=str(output / "scenario.yaml"))
    assert again.map == str(tmp_path / "one" / "map.json")


@pytest.mark.slow
@pytest.mark.parametrize(
    "planner, numbers",
    first(
        [
            (PlannerConfig(), [1, 1, 1]),  # the map does not change: no plan is quicker
            (
                PlannerConfig(lap="rest_to_rest", time_allocation="original", update="always"),
                [1, 2, 3],
            ),
            (PlannerConfig(update="always"), [1, 2, 3]),
        ]
    ),
    ids=["usual", "original", "always"],
)
def test_each_lap_says_which_plan_it_flew(hexagon, tmp_path, planner, numbers):
    scenario = Scenario(
        track=hexagon, laps=3, map="track", camera=BLIND, trajectory="4", planner=planner
    )
    result = run_race(scenario, tmp_path)
    assert result["finished"] and result["collisions"] == 0
    assert [lap["plan"]["number"] for lap in result["laps"]] == numbers
    for lap in result["laps"]:
        # The first comes from a hover.
        assert lap["time_s"] == pytest.approx(lap["plan"]["duration_s"], abs=1.0)
        assert max(lap["gate_offsets_m"]) < 1.0
    run = load_run(tmp_path)
    assert run.laps.plan.tolist() == numbers
    assert run.plans.plan.tolist() == run.plans.lap.tolist() == sorted(set(numbers))
    # What the plans say of gates is when they are passed, also by laps that rest beyond gate 1.
    planned = run.plan_gates.time[run.plan_gates.plan == numbers[2]].to_numpy()
    behind = gate_times(result["laps"][2]) - planned
    assert np.abs(behind - behind[0]).max() < 0.1


def test_with_a_camera_nobody_looks(hexagon):
    race = MakeRace(Scenario(track=hexagon, map="track"))
    autonomy = race.GetSubsystemByName("autonomy")
    assert not [
        i
        for i in range(autonomy.num_input_ports())
        if autonomy.get_input_port(i).get_name().startswith("camera")
    ]


def test_without_a_camera_no_lens_bends():
    harsh = load_scenario(filename="levels", scenario_name="Level3")
    assert any(harsh.camera.resolved().distortion)
    race = MakeRace(
        dc.replace(harsh, map="track", camera=dc.replace(harsh.camera, renderer="none"))
    )
    assert not race.GetSubsystemByName("autonomy").HasSubsystemNamed("rectifier")


def test_a_race_needs_eyes_or_a_map():
    with pytest.raises(UserError, match="needs a map to race on: see --map"):
        Scenario(camera=BLIND).check()
    with pytest.raises(UserError, match="map.json of an earlier race"):
        MakeRace(Scenario(map="nowhere.json"))
    with pytest.raises(UserError, match="--map is for SITL"):
        prepared(dc.replace(Scenario(), map="track"), lockstep=False)
