"""Races of a drone that nobody tells where it is."""

import re

import numpy as np
import pytest
from pydrake.common.yaml import yaml_dump_typed
from pydrake.systems.analysis import Simulator

from airrace.common.errors import UserError
from airrace.diagrams.race import MakeRace, run_race
from airrace.scenario import Scenario, load_scenario
from airrace.track import Track, load_track
from airrace.track.generator import generate_track
from airrace.vehicle.disturbances import RotorFailure
from airrace.vehicle.sensor_failures import CameraFailure, ImuFailure
from tests.worlds.cases import first
from tests.worlds.looks import Looks


def make_scenario(fps=15.0, **fields):
    """It takes half of the usual pictures, half as wide, to save time, unless a test says otherwise."""
    scenario = Scenario(track="hexagon", laps=1, estimator="vio", **fields)
    scenario.camera.width, scenario.camera.height, scenario.camera.fps = 640, 360, fps
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


@pytest.mark.repeats
def test_a_race_from_pixels_and_an_imu(tmp_path):
    """Undisturbed; see also test_sensors_that_fail_for_a_while_end_no_race()."""
    looks, scenario = Looks(), make_scenario(fps=30.0)
    result = run_race(scenario, tmp_path, sinks=[looks.take])
    assert result["finished"], result
    check_map(looks[-1].gate_map)


def check_map(known):
    """Checks that the map of the track "hexagon" is true to a few centimetres."""
    gates = load_track("hexagon").gates
    assert [gate.number for gate in known.gates] == list(range(len(gates)))
    for estimate, gate in zip(known.gates, gates):
        assert np.linalg.norm(estimate.p_WG - gate.p_WG) < 0.2


@pytest.mark.slow
def test_on_its_pad_a_drone_with_a_wrong_attitude_does_not_stir(tmp_path):
    """With any thrust, the controller would make it dance; the gate in sight is misleading."""
    track, scenario, looks = tmp_path / "track.yaml", make_scenario(fps=30.0, seed=6), Looks()
    track.write_text(yaml_dump_typed(generate_track(6), schema=Track))
    scenario.track, scenario.imu.preset, scenario.referee.time_limit = str(track), "harsh", 1.5
    run_race(scenario, tmp_path, sinks=[looks.take])
    states = [look.state[:7] for look in looks]
    assert len(states) > 10
    np.testing.assert_allclose(states, np.tile(states[0], (len(states), 1)), atol=1e-3)


@pytest.mark.repeats
def test_two_equal_races_are_equal_to_the_last_bit():
    states = []
    for _ in range(2):
        race = MakeRace(make_scenario())
        simulator = Simulator(race)
        simulator.AdvanceTo(7.0)
        context = simulator.get_context()
        autonomy = race.GetSubsystemByName("autonomy")
        port = autonomy.GetOutputPort("slam_state")
        simulation = race.GetSubsystemByName("simulation")
        state = simulation.GetOutputPort("truth.state")
        belief = port.Eval(autonomy.GetMyContextFromRoot(context)).belief
        states.append([state.Eval(simulation.GetMyContextFromRoot(context)), *belief])
    for a, b in zip(*states):
        np.testing.assert_array_equal(a, b)


@pytest.mark.slow
def test_sensors_that_fail_for_a_while_end_no_race(tmp_path):
    """It explores, maps and races, and neither 50 ms without an IMU, whatever it shows instead, nor a second
    in the dark, makes its map a bad one.
    """
    kinds = ("lost", "nan", "stuck", "saturated")
    scenario = make_scenario(
        imu_failures=[ImuFailure(kind, 8.0 + 4.0 * k, 0.05) for k, kind in enumerate(kinds)],
        camera_failures=[CameraFailure("dark", 24.0, 1.0)],
    )
    looks = Looks()
    result = run_race(scenario, tmp_path, sinks=[looks.take])
    assert result["finished"], result
    check_map(looks[-1].gate_map)


@pytest.mark.slow
@pytest.mark.parametrize("kind", first(["lost", "nan", "stuck", "saturated"]))
def test_without_an_imu_for_good_it_lands_and_says_why(tmp_path, kind):
    """In flight at 8 m/s, the rotors' own speeds have to do for a landing."""
    looks = Looks()
    result = run_race(
        make_scenario(imu_failures=[ImuFailure(kind, 7.5)]), tmp_path, sinks=[looks.take]
    )
    speeds = [np.linalg.norm(look.state[-3:]) for look in looks]
    assert not result["finished"] and result["collisions"] == 0
    lost = r"the drone gave up at 7.\d s \(the IMU fell silent\), and came down"
    assert re.fullmatch(lost, result["dnf_reason"])
    assert max(speeds) > 5.0 and speeds[-2] < 4.0, "a fall from there ends at 11 m/s"
    assert result["exploration"]["events"][-1]["state"] == "LAND"


@pytest.mark.repeats
def test_after_seven_seconds_in_the_dark_it_looks_at_known_gates_and_goes_on(tmp_path):
    """It is exploring, and would find the next gate too late to know where it is."""
    failures = [CameraFailure("dark", 26.0, 7.0)]
    result = run_race(make_scenario(camera_failures=failures), tmp_path)
    assert result["finished"] and result["collisions"] == 0
    assert "LOOK_BACK" in [event["state"] for event in result["exploration"]["events"]]


@pytest.mark.slow
def test_in_the_dark_for_good_it_lands_and_says_why(tmp_path):
    """Neither explores it for ever, nor does it fly into something."""
    result = run_race(make_scenario(camera_failures=[CameraFailure("dark", 5.0)]), tmp_path)
    assert not result["finished"] and result["collisions"] == 0
    lost = r"the drone gave up at .* s \(position uncertain by 5.\d m after .* s without a marker\), and came down"
    assert re.fullmatch(lost, result["dnf_reason"])


def test_an_imu_that_never_shows_anything_keeps_it_on_its_pad(tmp_path):
    result = run_race(make_scenario(imu_failures=[ImuFailure("lost", 0.0)]), tmp_path)
    assert result["dnf_reason"].endswith("and stayed on its pad") and not result["collisions"]


@pytest.mark.repeats
def test_with_a_rotor_lost_it_still_knows_where_it_is(tmp_path):
    """On five rotors, StarOne flies on; the estimator knows nothing of rotors but their speeds."""
    failures = [RotorFailure(1, 20.0)]
    result = run_race(make_scenario(drone="StarOne", rotor_failures=failures), tmp_path)
    assert result["finished"] and result["rotor_failures"][0]["noticed_s"] < 21.0, result
