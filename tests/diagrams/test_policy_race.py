"""Races that a network flies: in one diagram, over a link, and after a hand-back."""

import numpy as np
import pytest

from airrace.common.errors import UserError
from airrace.diagrams.autonomy import MakeAutonomy
from airrace.diagrams.race import run_race
from airrace.diagrams.variants import variant_of
from airrace.hitl.lcm_bridge import navigator_inputs, pilot_inputs
from airrace.hitl.link.simulated_bus import LinkConfig
from airrace.hitl.pilot import make_halves
from airrace.hitl.simulated_link import SimulatedRemote
from airrace.hitl.warm_up import play_pilot
from airrace.scenario import LEARNED, LINK_DELAY, VIO, Scenario, load_scenario, scenario_yaml
from airrace.scenario.camera_config import NO_CAMERA, CameraConfig
from airrace.systems.exploring.explorer import Explorer
from airrace.systems.mapping.known_map import KnownMap, NoDetector
from airrace.track import load_track
from airrace.track.map_files import read_map
from airrace.vehicle import load_vehicle
from tests.worlds.linear_policy import linear_network
from tests.worlds.looks import Looks

BLIND = CameraConfig(renderer=NO_CAMERA)


def policy_file(folder, drone="Default", **changes):
    path = folder / "policy.npz"
    linear_network(load_vehicle(drone)[0], **changes).save(path)
    return str(path)


def timid(speed):
    """Returns the bounds of a network that knows no more than a speed forward (m/s)."""
    high = np.full(43, np.inf)
    high[0] = speed
    return {"high": high}


# The navigator of a race over a link on a map that is given, which races usually have not.
def no_detector(scenario):
    return NoDetector()


def known_map(scenario):
    return KnownMap(read_map("track", scenario.track))


def explorer(scenario):
    height = load_track(scenario.track).hover_height
    return Explorer(config=scenario.explorer, hover_height=height, clearance=2.0, map_is_known=True)


def fly_lap(track, folder, name):
    """Returns race.json of a lap on a given map, without what depends on the machine."""
    (folder / name).mkdir()
    scenario = Scenario(track=track, laps=1, map="track", camera=BLIND, policy=policy_file(folder))
    result = run_race(scenario, folder / name)
    result.pop("wall")
    return result


@pytest.mark.repeats
def test_a_network_flies_the_lap(hexagon, tmp_path):
    result = fly_lap(hexagon, tmp_path, "race")
    assert result["finished"] and result["collisions"] == 0
    assert [event["what"] for event in result["policy"]["events"]] == ["the network flies"]
    assert result["laps"][0]["plan"] is None and max(result["laps"][0]["gate_offsets_m"]) < 4.0


@pytest.mark.repeats
def test_it_flies_twice_alike(hexagon, tmp_path):
    assert fly_lap(hexagon, tmp_path, "first") == fly_lap(hexagon, tmp_path, "second")


@pytest.mark.slow
def test_the_shipped_network_flies_the_reference_track(tmp_path):
    result = run_race(Scenario(laps=1, map="track", camera=BLIND, policy=LEARNED), tmp_path)
    assert result["finished"] and result["collisions"] == 0
    assert [event["what"] for event in result["policy"]["events"]] == ["the network flies"]
    assert result["best_lap_s"] < 15.0


def test_a_drone_without_a_shipped_network():
    with pytest.raises(UserError, match="no learned policy for the drone StarOne: train one"):
        MakeAutonomy(Scenario(drone="StarOne", policy=LEARNED))


@pytest.mark.slow
def test_after_a_hand_back_the_planner_finishes_the_race(hexagon, tmp_path):
    scenario = Scenario(track=hexagon, laps=1, map="track", camera=BLIND, trajectory="4")
    scenario.policy = policy_file(tmp_path, **timid(4.0))
    result = run_race(scenario, tmp_path)
    assert result["finished"] and result["collisions"] == 0
    first, second = (event["what"] for event in result["policy"]["events"])
    assert first == "the network flies"
    assert second == "the planner flies: it saw what it was not trained on"
    assert result["laps"][0]["plan"]["number"] == 1


@pytest.mark.repeats
def test_a_network_flies_over_a_link(hexagon, tmp_path):
    """The pilot has a diagram of its own there, and so has the navigator."""
    scenario = Scenario(track=hexagon, laps=1, link_delay=LINK_DELAY, trajectory="4")
    scenario.referee.time_limit = 24.0
    low = np.full(43, -np.inf)
    low[3] = 0.3  # the cosine of the heading: on the way to gate 3 it turns farther
    scenario.policy = policy_file(tmp_path, low=low)
    for name, make in (
        ("aruco_detector", "no_detector"),
        ("gate_mapper", "known_map"),
        ("explorer", "explorer"),
    ):
        scenario.systems[name] = f"{__name__}:{make}"
    folder = tmp_path / "autonomy"
    folder.mkdir()
    flew, looks = [], Looks()
    link = LinkConfig(delay=0.02, jitter=0.005, loss=0.01)

    class Watched(SimulatedRemote):
        def advance(self, simulator, end):
            result = super().advance(simulator, end)
            side = self._pilot._side
            status = side.part.GetOutputPort("policy_status").Eval(
                side.part.GetMyContextFromRoot(self._pilot._context)
            )
            flew.append((status.flies, status.passed, status.reason))
            return result

    result = run_race(
        scenario, tmp_path, transport=Watched(scenario, link, folder), sinks=[looks.take]
    )
    assert any(flies for flies, _, _ in flew)
    passed, reason = flew[-1][1:]
    assert passed >= 1 and reason == "it saw what it was not trained on"
    # The planner is told of it, and plans only then.
    handed = [bool(reason) for _, _, reason in flew]
    plans = [look.plan is not None for look in looks]
    assert plans[-1] and plans.index(True) > handed.index(True)
    assert result["collisions"] == 0 and result["wall"]["link"]["watchdog"]["hovers"] == 0
    assert result["dnf_reason"].startswith("ran out of time")


def test_its_systems_are_the_pilots_half(tmp_path):
    scenario = Scenario(policy=policy_file(tmp_path))
    added = variant_of(scenario).systems.keys() - variant_of(Scenario()).systems.keys()
    assert added == {"policy_controller", "rate_controller", "command_switch"}
    pilot, navigator = make_halves(scenario)
    names = {system.get_name() for system in pilot.GetSystems()}
    assert added <= names
    assert {"gate_map", "explorer_status", "exploration_reference"} <= {
        *pilot_inputs(pilot, navigator)
    }
    assert {"safe_reference", "policy_status"} <= {*navigator_inputs(pilot, navigator)}


def test_no_command_waits_for_a_picture(tmp_path):
    autonomy = MakeAutonomy(Scenario(policy=policy_file(tmp_path)))
    command = autonomy.GetOutputPort("rotor_speed_command").get_index()
    assert not any(
        autonomy.HasDirectFeedthrough(i, command) for i in range(autonomy.num_input_ports())
    )
    planned = MakeAutonomy(Scenario())
    assert not planned.HasSubsystemNamed("policy_controller")


def test_with_vio_too(tmp_path):
    MakeAutonomy(Scenario(policy=policy_file(tmp_path), estimator=VIO))


@pytest.mark.slow
def test_the_pilot_warms_up_in_real_time(tmp_path):
    assert len(play_pilot(Scenario(policy=policy_file(tmp_path)), 0.1)) == 100


def test_a_scenario_names_its_policy(tmp_path, monkeypatch):
    policy_file(tmp_path)
    monkeypatch.chdir(tmp_path)
    text = scenario_yaml(load_scenario(scenario_text="{policy: policy.npz}"))
    assert f"policy: {tmp_path}/policy.npz" in text
    with pytest.raises(UserError, match=r"policy \(--policy\) must be none, learned, or the .npz"):
        load_scenario(scenario_text="{policy: autopilot}").check()


def test_policies_that_cannot_be_had(tmp_path):
    with pytest.raises(UserError, match="none.npz cannot be read"):
        MakeAutonomy(Scenario(policy=str(tmp_path / "none.npz")))
    with pytest.raises(UserError, match="was trained on the drone StarOne, not on Default"):
        MakeAutonomy(Scenario(policy=policy_file(tmp_path, "StarOne")))
