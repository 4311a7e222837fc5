"""Races of a drone that nobody tells where it is."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from airrace.common.errors import UserError
from airrace.diagrams.race import MakeRace, run_race
from airrace.scenario import Scenario, load_scenario
from airrace.track import load_track
from airrace.vehicle.sensor_failures import CameraFailure, ImuFailure


def make_scenario(**fields):
    scenario = Scenario(track="hexagon", laps=1, estimator="vio", **fields)
    scenario.recording.content = "none"
    scenario.check()
    return scenario


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("{estimator: vio, map: track}", "--map"),
        ("{estimator: vio, map: track, camera: {renderer: none}}", "--map"),
        ("{estimator: gps}", "estimator must be one of truth, vio"),
    ],
)
def test_what_cannot_be(text, word):
    with pytest.raises(UserError, match=word):
        load_scenario(scenario_text=text).check()


def test_a_system_that_is_not_there():
    scenario = make_scenario(systems={"gate_mapper": "json:loads"})
    with pytest.raises(UserError, match="there are: .*gate_slam"):
        MakeRace(scenario)


@pytest.mark.slow
def test_a_race_from_pixels_and_an_imu(tmp_path):
    """It explores, maps and races, and its map is true to a few centimetres."""
    maps = []
    scenario = make_scenario()
    result = run_race(scenario, tmp_path, show=lambda _, outputs: maps.append(outputs.gate_map))
    assert result["finished"], result
    gates = load_track("hexagon").gates
    assert [gate.number for gate in maps[-1].gates] == list(range(len(gates)))
    for estimate, gate in zip(maps[-1].gates, gates):
        assert np.linalg.norm(estimate.p_WG - gate.p_WG) < 0.2


@pytest.mark.slow
def test_two_equal_races_are_equal_to_the_last_bit():
    states = []
    for _ in range(2):
        race = MakeRace(make_scenario())
        simulator = Simulator(race)
        simulator.AdvanceTo(7.0)
        context = simulator.get_context()
        autonomy = race.GetSubsystemByName("autonomy")
        port = autonomy.GetOutputPort("slam_state")
        belief = port.Eval(autonomy.GetMyContextFromRoot(context)).belief
        states.append([race.GetOutputPort("truth.state").Eval(context), *belief])
    for a, b in zip(*states):
        np.testing.assert_array_equal(a, b)


@pytest.mark.slow
def test_sensors_that_fail_for_a_while_end_no_race(tmp_path):
    """Neither 50 ms without an IMU, whatever it shows instead, nor five seconds in the dark."""
    kinds = ("lost", "nan", "stuck", "saturated")
    scenario = make_scenario(
        imu_failures=[ImuFailure(kind, 8.0 + 4.0 * k, 0.05) for k, kind in enumerate(kinds)],
        camera_failures=[CameraFailure("dark", 25.0, 5.0)],
    )
    result = run_race(scenario, tmp_path)
    assert result["finished"], result
