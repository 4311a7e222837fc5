"""What of a race its entry is told: nothing that gives the track or the noise away."""

import dataclasses as dc

import pytest
import yaml

from airrace.common.errors import UserError
from airrace.common.resources import load_yaml
from airrace.league.entry import load_entry
from airrace.league.scenarios import make_flown
from airrace.league.season import Season, make_legs
from airrace.scenario import Scenario, load_scenario
from airrace.track import Track
from tests.league.entries import make_entry

SEASON = Season(name="s", tracks=1, levels=[3], track="student-airrace", seed_file="s")


@pytest.fixture(scope="module")
def leg():
    return make_legs(SEASON, "nobody can guess this")[0]


def flown(leg, entry, season=SEASON):
    return make_flown(season, leg, load_entry(entry))


def fields(text):
    return yaml.safe_load(text)["Defaults"]


def test_the_simulation_is_told_all(leg, tmp_path):
    path = tmp_path / "scenario.yaml"
    path.write_text(flown(leg, "optimal").scenario)
    scenario = load_scenario(filename=str(path))
    level = load_scenario(filename="levels", scenario_name="Level3")
    assert scenario.seed == leg.seed and scenario.laps == SEASON.laps
    assert scenario.disturbances == level.disturbances and scenario.camera == level.camera
    assert scenario.simulator_config.target_realtime_rate == 0.0


def test_the_entry_is_told_no_seed_no_track_and_nothing_that_is_drawn(leg):
    made = flown(leg, "optimal")
    told, all = fields(made.entry_scenario), fields(made.scenario)
    default = dc.asdict(Scenario())
    assert told["seed"] == default["seed"] != all["seed"]
    assert str(leg.seed) not in made.entry_scenario + made.entry_track
    secret = {name for name in all if told[name] != all[name]}
    assert {"disturbances", "seed"} <= secret
    assert not secret & {"perception", "explorer", "planner", "controller", "camera", "rotors"}


def test_the_track_that_an_entry_is_given_is_one_that_everybody_knows(leg):
    given = load_yaml(Track, data=flown(leg, "optimal").entry_track)
    true = load_yaml(Track, data=leg.track)
    hexagon = load_yaml(Track, data=make_legs(dc.replace(SEASON, track="hexagon"), "x")[0].track)
    assert given.hover_height == true.hover_height
    assert given.gates == hexagon.gates != true.gates


def test_both_sides_compute_with_the_same_settings(leg, tmp_path):
    text = "team: A\nautonomy: {trajectory: '4', controller: {rate: 400}}\n"
    entry = make_entry(tmp_path / "a", text + "systems: {explorer: 'mine:make'}\n", mine="")
    made = flown(leg, entry)
    for side in map(fields, (made.scenario, made.entry_scenario)):
        assert side["trajectory"] == "4" and side["controller"]["rate"] == 400.0
        assert side["systems"] == {"explorer": "mine:make"}


def test_rules_of_the_season(leg, tmp_path):
    star = make_entry(tmp_path / "star", "team: A\ndrone: StarOne\n")
    with pytest.raises(UserError, match="flies StarOne; this season is for Default"):
        flown(leg, star, dc.replace(SEASON, drones=["Default"]))
    told = make_entry(tmp_path / "told", "team: A\nautonomy: {estimator: truth}\n")
    with pytest.raises(UserError, match="wants to be told where it is"):
        flown(leg, told, dc.replace(SEASON, estimator="vio"))
    assert fields(flown(leg, "vio").scenario)["estimator"] == "vio"
